"""`halfangle dictionary`: the BRDF dictionaries that are built in."""

from __future__ import annotations

import click

from cli.output import table

NAMES = ("parametric", "sgd", "abc")


@click.group()
def dictionary() -> None:
    """Look at the BRDF dictionaries that are built in."""


@dictionary.command("list", epilog="Example: halfangle dictionary list")
def list_dictionaries() -> None:
    """List the dictionaries and the number of their atoms."""
    from analysis.dictionary import by_name

    sources = {
        "parametric": "diffuse, grazing and lobe shapes; needs no measured data (default)",
        "sgd": "100 MERL materials as fitted by Bagher et al. 2012, three channels each",
        "abc": "100 MERL materials as fitted by Low et al. 2012, three channels each",
    }
    click.echo("\n".join(f"{name:12}{len(by_name(name).atoms):4} atoms  {sources[name]}" for name in NAMES))


@dictionary.command(epilog="Example: halfangle dictionary info parametric")
@click.argument("name", type=click.Choice(NAMES))
def info(name: str) -> None:
    """Print the atoms of dictionary NAME: model, parameters, curve at five half angles."""
    import numpy as np

    from analysis.dictionary import by_name
    from analysis.reflectance import Cosines

    chosen = by_name(name)
    degrees = (0, 5, 20, 45, 70)
    values = chosen.evaluate(Cosines.on_slice(np.deg2rad(np.array(degrees, float))))
    rows = [("model", "a", "b", *(f"f({d}°)" for d in degrees))]
    for index, atom in enumerate(chosen.atoms):
        rows.append((atom.model, f"{atom.a:.4g}", f"{atom.b:.4g}", *(f"{v:.3g}" for v in values[:, index])))
    click.echo(table(rows))
