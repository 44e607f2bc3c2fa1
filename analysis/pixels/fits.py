"""What is known of pixels once they are solved: normals, coefficients, quality, and what they predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.models import Cosines

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PixelFits:
    """Fits of P pixels in C channels.

    Attributes
    ----------
    normals : ndarray, shape (P, 3)
        NaN = not solved.
    covariance : ndarray, shape (P, 3)
        xx, xy, yy of the two tangent parameters, rad^2.
    reduced_chi2 : ndarray, shape (P,)
        Of the views that are not taken for wrong.
    loss : ndarray, shape (P,)
        Cauchy's loss a view, all of them counted; about 1 where the fit is as good as its noise. Evidence for
        choices, not kept in files: NaN where read from one.
    atom : ndarray of int16, shape (P, C, MAX_ATOMS)
        Index into the dictionary; -1 = none.
    coefficient : ndarray, shape (P, C, MAX_ATOMS)
        Non-negative; times the atom in 1/sr and summed over the atoms it gives the BRDF.
    flags : ndarray of uint8, shape (P,)
        Bits of `analysis.pixels.samples`.
    theta_h_range : ndarray, shape (P, 2)
        Smallest and largest half angle seen, rad.
    dictionary : Dictionary
    """

    normals: Array
    covariance: Array
    reduced_chi2: Array
    loss: Array
    atom: NDArray[np.int16]
    coefficient: Array
    flags: NDArray[np.uint8]
    theta_h_range: Array
    dictionary: Dictionary

    def select(self, pixels: NDArray[np.int64]) -> PixelFits:
        """Return the fits of these pixels only."""
        return PixelFits(
            normals=self.normals[pixels],
            covariance=self.covariance[pixels],
            reduced_chi2=self.reduced_chi2[pixels],
            loss=self.loss[pixels],
            atom=self.atom[pixels],
            coefficient=self.coefficient[pixels],
            flags=self.flags[pixels],
            theta_h_range=self.theta_h_range[pixels],
            dictionary=self.dictionary,
        )

    def replaced(self, pixels: NDArray[np.int64], by: PixelFits) -> PixelFits:
        """Return these fits with those of `pixels` taken from `by`, which may use another dictionary."""

        def put(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
            a = a.copy()
            a[pixels] = b
            return a

        dictionary, atom = self.dictionary, by.atom
        if by.dictionary is not dictionary:
            atom = np.where(atom >= 0, atom + len(dictionary.atoms), -1).astype(np.int16)
            dictionary = Dictionary(dictionary.name, (*dictionary.atoms, *by.dictionary.atoms))
        return PixelFits(
            normals=put(self.normals, by.normals),
            covariance=put(self.covariance, by.covariance),
            reduced_chi2=put(self.reduced_chi2, by.reduced_chi2),
            loss=put(self.loss, by.loss),
            atom=put(self.atom, atom),
            coefficient=put(self.coefficient, by.coefficient),
            flags=put(self.flags, by.flags),
            theta_h_range=put(self.theta_h_range, by.theta_h_range),
            dictionary=dictionary,
        )

    @property
    def n_coefficients(self) -> NDArray[np.int64]:
        """Number of free coefficients of each pixel: a material's is one for all channels."""
        used = self.atom >= 0
        again = used[:, 1:] & used[:, :-1] & (self.atom[:, 1:] != self.atom[:, :-1])
        again &= self.coefficient[:, 1:] == self.coefficient[:, :-1]
        return np.asarray(np.count_nonzero(used, axis=(1, 2)) - np.count_nonzero(again, axis=(1, 2)))

    @property
    def normal_sigma(self) -> Array:
        """Standard deviation per tangent axis, rad: root of half the trace of the covariance."""
        return np.asarray(np.sqrt(0.5 * (self.covariance[:, 0] + self.covariance[:, 2])))

    def widened(self, sigma: float) -> PixelFits:
        """Return the fits with an error that all pixels share added to the normals' covariance, rad per axis."""
        return replace(self, covariance=self.covariance + sigma**2 * np.array([1.0, 0.0, 1.0]))

    def brdf(self, cosines: Cosines) -> Array:
        """Return the BRDF of each pixel in 1/sr, shape (P, ..., C), at `cosines` of shape (P, ...)."""
        shape = cosines.n_dot_h.shape
        value = np.zeros((*shape, self.atom.shape[1]))
        for k in np.unique(self.atom[self.atom >= 0]):
            used = self.atom == k
            users = np.flatnonzero(used.any(axis=(1, 2)))
            weight = np.sum(np.where(used[users], self.coefficient[users], 0.0), axis=-1)
            atom = self.dictionary.atoms[k]
            part = Cosines(cosines.n_dot_h[users], cosines.cos_d[users], cosines.n_dot_l[users], cosines.n_dot_v[users])
            curve = atom.evaluate(part)
            value[users] += curve[..., None] * weight.reshape(len(users), *(1,) * (len(shape) - 1), weight.shape[1])
        return value

    def radiance(self, points: Array, camera: Array, light: Array, light_power: float = 1.0) -> Array:
        """Predict what a view shows, shape (P, C), in the stack's units.

        radiance = P / d^2 f(omega_i, omega_o) max(0, n.omega_i), without cast shadows.

        Parameters
        ----------
        points : ndarray, shape (P, 3)
        camera, light : ndarray, shape (3,)
            Sample frame, mm.
        """
        to_light, to_camera = light - points, camera - points
        d2 = np.sum(to_light**2, axis=-1)
        omega_i = to_light / np.sqrt(d2)[:, None]
        omega_o = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
        n_dot_l = np.sum(self.normals * omega_i, axis=-1)
        n_dot_v = np.sum(self.normals * omega_o, axis=-1)
        with np.errstate(invalid="ignore"):
            lit = np.where((n_dot_l > 0.0) & (n_dot_v > 0.0), n_dot_l, np.where(np.isnan(n_dot_l), np.nan, 0.0))
        f = self.brdf(Cosines.from_directions(self.normals, omega_i, omega_o))
        return np.asarray(light_power * f * (lit / d2)[:, None])


def joined(parts: Sequence[PixelFits]) -> PixelFits:
    """Join the fits of several sets of pixels, all of one dictionary."""
    names = [field.name for field in fields(PixelFits) if field.name != "dictionary"]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return PixelFits(**arrays, dictionary=parts[0].dictionary)
