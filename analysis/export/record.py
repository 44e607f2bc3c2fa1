"""What an export says of itself: `export.json`, and the lines that the command prints."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any

import numpy as np

from analysis.export.comparison import ViewError
from analysis.export.maps import Prepared
from analysis.export.textures import Textures
from analysis.results.summary import SourceFile

CONVENTIONS = {
    "rows": "the first row is at the top; u to the right",
    "color": "PNG sRGB, EXR linear Rec. 709; albedo of a dielectric, reflectance at normal incidence of a metal",
    "normals": "(n + 1) / 2 of x right, y up, z out of the sample; GL: green up; DX: green down",
    "roughness": "alpha = roughness squared (GGX)",
    "metalness": "1 metal, 0 dielectric, between them a pixel that holds some of each",
    "specular": "F0 / 0.08 of a dielectric: 0.5 is an index of refraction of 1.5",
    "clearcoat": "weight of a coat of F0 0.04 with a roughness of its own",
    "displacement": "along the normal of the mean plane; EXR in mm; PNG 0.5 = mean plane",
    "data maps": "raw numbers, no colour space",
    "length": "mm, if nothing else is said",
}


@dataclass(frozen=True)
class Record:
    """An export, judged.

    Attributes
    ----------
    prepared : Prepared
    textures : Textures
        As they were written.
    errors : tuple of ViewError
        Of pictures of those textures.
    source : str
        Name of the result's file.
    """

    prepared: Prepared
    textures: Textures
    errors: tuple[ViewError, ...]
    source: str

    def as_dict(self) -> dict[str, Any]:
        """Return the record for JSON."""
        maps, stack = self.prepared.maps, self.prepared.result.summary.source
        height, width = maps.shape
        sigma = maps.normal_sigma_deg[maps.solved]
        return {
            "program": f"halfangle {version('halfangle')}",
            "result": self.source,
            "stack": None if stack is None else _source(stack),
            "pixels": [width, height],
            "size_mm": list(maps.size_mm),
            "pixel_mm": [maps.size_mm[0] / width, maps.size_mm[1] / height],
            "scale": asdict(self.prepared.scale),
            "displacement": {"mean_plane": 0.5, "range_mm": self.textures.displacement_range_mm},
            "normal_sigma_deg": {"median": float(np.median(sigma)), "p95": float(np.percentile(sigma, 95.0))},
            "counts": asdict(self.prepared.counts),
            "errors": [asdict(error) for error in self.errors],
            "conventions": CONVENTIONS,
        }


def _heights_text(record: Record) -> str:
    if not np.isfinite(record.prepared.result.depth).any():
        return "none: the result has no depth"
    return f"0.5 is the mean plane, the range is +- {record.textures.displacement_range_mm:.4g} mm"


def _source(stack: SourceFile) -> dict[str, str]:
    return {"file": stack.file, "sha256": stack.sha256}


def record_text(record: Record) -> str:
    """Return what is to be known of an export, for a terminal or a README."""
    maps, counts, scale = record.prepared.maps, record.prepared.counts, record.prepared.scale
    height, width = maps.shape
    lines = [
        f"size        {maps.size_mm[0]:.6g} x {maps.size_mm[1]:.6g} mm, {width} x {height} pixels",
        f"scale       {scale.factor:.4g} ({scale.reason})",
        f"heights     {_heights_text(record)}",
        f"pixels      {counts.n_pixels}: {counts.n_unsolved} not solved (see the mask), "
        f"{counts.n_outside_palette} outside the palette",
        f"limits      {counts.n_clipped} pixels with a colour clipped to 1, {counts.n_dull} with F0 held at 0.08",
        f"fit         {counts.fit_error_median:.1%} of the BRDF (median), {counts.fit_error_p95:.1%} (95 %)",
        "against the result's own render, camera and light that far from the normal:",
    ]
    lines += [
        f"  {error.camera_deg:2.0f}, {error.light_deg:2.0f} deg  (theta_d {error.theta_d_deg:2.0f})  "
        f"{error.psnr_db:5.1f} dB  mean dE00 {error.delta_e:.2f}"
        for error in record.errors
    ]
    return "\n".join(lines)
