"""`halfangle dictionary`: the BRDF dictionaries that are built in, and those made from measured materials."""

from __future__ import annotations

from pathlib import Path

import click

from cli.output import FILE, PATH, check_new, quiet_option
from cli.progress import run_bar
from instrument.files.validation import LINE_BREAK, printable


@click.group()
def dictionary() -> None:
    """Look at BRDF dictionaries and make them from measured materials."""


@dictionary.command("list", epilog="Example: halfangle dictionary list")
@click.argument("file", type=FILE, required=False)
def list_dictionaries(file: Path | None) -> None:
    """List the dictionaries that are built in, or the materials in a dictionary FILE."""
    from analysis.reflectance.dictionary_file import read_dictionary
    from analysis.reflectance.text import built_in_text, materials_text
    from instrument.files.probe import refuse_dangerous

    if file is None:
        click.echo(built_in_text())
        return
    refuse_dangerous(file)
    click.echo(printable(materials_text(read_dictionary(file)), keep=LINE_BREAK))


@dictionary.command(epilog="Example: halfangle dictionary info parametric")
@click.argument("name")
def info(name: str) -> None:
    """Print the atoms of dictionary NAME, or of a file: model, parameters, curve at five half angles."""
    from analysis.reflectance.dictionary import by_name
    from analysis.reflectance.text import atoms_text
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(Path(name))
    click.echo(printable(atoms_text(by_name(name)), keep=LINE_BREAK))


@dictionary.command(epilog="Example: halfangle dictionary build merl -o merl.dictionary.h5 --categories categories.csv")
@click.argument("folder", metavar="DIR", type=PATH)
@click.option("-o", "--output", type=FILE, required=True, help="Dictionary file to write.")
@click.option("--categories", type=FILE, help="CSV with the columns name and category.")
@quiet_option
def build(folder: Path, output: Path, categories: Path | None, quiet: bool) -> None:
    """Build a dictionary from the files of MERL (*.binary) and of the RGL database (*_rgb.bsdf) in DIR."""
    check_new(output)
    from analysis.reflectance.dictionary_build import build_dictionary
    from analysis.reflectance.dictionary_file import write_dictionary

    with run_bar("dictionary", quiet=quiet) as (_, track):
        tables = build_dictionary(folder, categories, track)
    write_dictionary(output, tables)
    size = output.stat().st_size / 1e6
    click.echo(f"{output}: {len(tables.materials)} materials, {len(tables.atoms)} atoms, {size:.2f} MB")
