"""`halfangle dictionary`: the BRDF dictionaries that are built in, and those made from measured materials."""

from __future__ import annotations

from pathlib import Path

import click

from cli.output import check_new
from cli.progress import run_bar
from instrument.files.text_table import text_table
from instrument.files.validation import LINE_BREAK, printable

FILE = click.Path(path_type=Path, dir_okay=False)


@click.group()
def dictionary() -> None:
    """Look at BRDF dictionaries and make them from measured materials."""


@dictionary.command("list", epilog="Example: halfangle dictionary list")
@click.argument("file", type=FILE, required=False)
def list_dictionaries(file: Path | None) -> None:
    """List the dictionaries that are built in, or the materials in a dictionary FILE."""
    click.echo(printable(_materials(file), keep=LINE_BREAK) if file else _built_in())


def _built_in() -> str:
    from analysis.reflectance.dictionary import by_name

    sources = {
        "parametric": "diffuse, grazing and lobe shapes; needs no measured data (default)",
        "sgd": "100 MERL materials as fitted by Bagher et al. 2012, three channels each",
        "abc": "100 MERL materials as fitted by Low et al. 2012, three channels each",
    }
    return "\n".join(f"{name:12}{len(by_name(name).atoms):4} atoms  {text}" for name, text in sources.items())


def _materials(file: Path) -> str:
    from analysis.reflectance.dictionary_file import read_dictionary
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(file)
    tables = read_dictionary(file)
    rows = [("material", "category", "cells measured", "sha256 of the file")]
    for material in tables.materials:
        share = f"{100 * tables.measured_share(material.name):.1f} %"
        rows.append((material.name, material.category or "-", share, material.sha256))
    return text_table(rows)


@dictionary.command(epilog="Example: halfangle dictionary info parametric")
@click.argument("name")
def info(name: str) -> None:
    """Print the atoms of dictionary NAME, or of a file: model, parameters, curve at five half angles."""
    import numpy as np

    from analysis.reflectance.atoms import Atom
    from analysis.reflectance.dictionary import by_name
    from analysis.reflectance.models import Cosines
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(Path(name))
    chosen = by_name(name)
    degrees = (0, 5, 20, 45, 70)
    values = chosen.evaluate(Cosines.on_slice(np.deg2rad(np.array(degrees, float))))
    rows = [("model", "a", "b", *(f"f({d}°)" for d in degrees))]
    for index, atom in enumerate(chosen.atoms):
        head = (atom.model, f"{atom.a:.4g}", f"{atom.b:.4g}") if isinstance(atom, Atom) else (atom.label, "-", "-")
        rows.append((*head, *(f"{v:.3g}" for v in values[:, index])))
    click.echo(printable(text_table(rows), keep=LINE_BREAK))


@dictionary.command(epilog="Example: halfangle dictionary build merl -o merl.dictionary.h5 --categories categories.csv")
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=FILE, required=True, help="Dictionary file to write.")
@click.option("--categories", type=FILE, help="CSV with the columns name and category.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")
def build(folder: Path, output: Path, categories: Path | None, quiet: bool) -> None:
    """Build a dictionary from the MERL files (*.binary) in DIR."""
    check_new(output)
    from analysis.reflectance.dictionary_build import build_dictionary
    from analysis.reflectance.dictionary_file import write_dictionary

    with run_bar("dictionary", quiet=quiet) as (_, track):
        tables = build_dictionary(folder, categories, track)
    write_dictionary(output, tables)
    size = output.stat().st_size / 1e6
    click.echo(f"{output}: {len(tables.materials)} materials, {len(tables.atoms)} atoms, {size:.2f} MB")
