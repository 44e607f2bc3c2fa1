"""Prints dictionaries for the terminal."""

from __future__ import annotations

import numpy as np

from analysis.reflectance.atoms import Atom
from analysis.reflectance.dictionary import Dictionary, by_name
from analysis.reflectance.dictionary_file import MaterialTables
from analysis.reflectance.models import Cosines
from instrument.files.text_table import text_table

_SHOWN_DEG = (0, 5, 20, 45, 70)


def built_in_text() -> str:
    """Return a line about each dictionary that is built in."""
    sources = {
        "lambert": "one Lambertian atom; what is taken where camera and light stand far apart",
        "parametric": "diffuse, grazing and lobe shapes; needs no measured data (default)",
        "sgd": "100 MERL materials as fitted by Bagher et al. 2012, three channels each",
        "abc": "100 MERL materials as fitted by Low et al. 2012, three channels each",
    }
    return "\n".join(f"{name:12}{len(by_name(name).atoms):4} atoms  {text}" for name, text in sources.items())


def materials_text(tables: MaterialTables) -> str:
    """Return a line about each material of a dictionary that was built."""
    rows = [("material", "category", "cells measured", "sha256 of the file")]
    for material in tables.materials:
        share = f"{100 * tables.measured_share(material.name):.1f} %"
        rows.append((material.name, material.category or "-", share, material.sha256))
    return text_table(rows)


def atoms_text(dictionary: Dictionary) -> str:
    """Return a line about each atom: model, parameters, curve at five half angles."""
    values = dictionary.evaluate(Cosines.on_slice(np.deg2rad(np.array(_SHOWN_DEG, float))))
    rows = [("model", "a", "b", *(f"f({d}°)" for d in _SHOWN_DEG))]
    for index, atom in enumerate(dictionary.atoms):
        head = (atom.model, f"{atom.a:.4g}", f"{atom.b:.4g}") if isinstance(atom, Atom) else (atom.label, "-", "-")
        rows.append((*head, *(f"{v:.3g}" for v in values[:, index])))
    return text_table(rows)
