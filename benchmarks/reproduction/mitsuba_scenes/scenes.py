"""The scenes: a relief, and which materials lie where on it, as Mitsuba's elements name them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.reproduction.mitsuba_scenes.surfaces import Surface, leaf, medal, weave

Array = NDArray[np.float64]

Textures = dict[str, Array]


@dataclass(frozen=True)
class Scene:
    """A sample to render.

    Attributes
    ----------
    name : str
    surface : Surface
    materials : str
        Its BSDF as XML; ``{name}`` stands for the element of a texture.
    textures : callable
        Values 0 to 1 of each texture at points x, y (mm): (H, W) for numbers, (H, W, 3) for linear colours.
    """

    name: str
    surface: Surface
    materials: str
    textures: Callable[[Array, Array], Textures]


def _step(t: Array) -> Array:
    return np.asarray(0.5 * (1.0 + np.tanh(t)))


def _colour(first: tuple[float, ...], second: tuple[float, ...], share: Array) -> Array:
    return np.asarray((1.0 - share)[..., None] * np.array(first) + share[..., None] * np.array(second))


MEDAL = Scene(
    "medal",
    Surface(medal),
    """
    <bsdf type="blendbsdf">
      {on_field}
      <bsdf type="blendbsdf">
        {on_star}
        <bsdf type="roughplastic">
          <string name="distribution" value="ggx"/> <float name="alpha" value="0.22"/>
          <rgb name="diffuse_reflectance" value="0.10, 0.22, 0.45"/>
        </bsdf>
        <bsdf type="roughconductor">
          <string name="material" value="Au"/>
          <string name="distribution" value="ggx"/> <float name="alpha" value="0.25"/>
        </bsdf>
      </bsdf>
      <bsdf type="blendbsdf">
        <float name="weight" value="0.45"/>
        <bsdf type="diffuse"> <rgb name="reflectance" value="0.45, 0.40, 0.36"/> </bsdf>
        <bsdf type="roughconductor">
          <string name="material" value="Cu"/>
          <string name="distribution" value="beckmann"/> <float name="alpha" value="0.35"/>
        </bsdf>
      </bsdf>
    </bsdf>""",
    lambda x, y: {
        "on_field": _step((np.hypot(x, y) - 17.0) / 0.35),
        "on_star": _step((9.0 + 2.2 * np.cos(5.0 * (np.arctan2(y, x) - 0.4)) - np.hypot(x, y)) / 0.3),
    },
)

LEAF = Scene(
    "leaf",
    Surface(leaf),
    """
    <bsdf type="principled">
      {base_color} {roughness}
      <float name="specular" value="0.5"/>
    </bsdf>""",
    lambda x, y: {
        "base_color": _colour(
            (0.08, 0.26, 0.05), (0.55, 0.38, 0.12), _step((np.sin(x / 5.0 + 0.4 * y) + 0.6 * np.cos(y / 3.0)) / 0.5)
        )
        + 0.15 * np.exp(-((y / 1.6) ** 2))[..., None],
        "roughness": 0.42 + 0.12 * np.sin(x / 6.0) * np.cos(y / 4.5),
    },
)

WEAVE = Scene(
    "weave",
    Surface(weave),
    """
    <bsdf type="blendbsdf">
      {is_weft}
      <bsdf type="principled">
        {base_color}
        <float name="roughness" value="0.7"/> <float name="sheen" value="0.8"/>
      </bsdf>
      <bsdf type="principled">
        <rgb name="base_color" value="0.75, 0.70, 0.55"/>
        <float name="metallic" value="0.7"/> <float name="roughness" value="0.5"/>
      </bsdf>
    </bsdf>""",
    lambda x, y: {
        "is_weft": _step(np.sin(2.0 * np.pi * x / 8.0) * np.sin(2.0 * np.pi * y / 8.0) / 0.15),
        "base_color": _colour((0.35, 0.06, 0.08), (0.10, 0.12, 0.35), _step((np.sin(x / 4.0) + np.sin(y / 7.0)) / 0.4)),
    },
)

SCENES = (MEDAL, LEAF, WEAVE)
