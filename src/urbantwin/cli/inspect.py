"""``urbantwin inspect``: what a file or a folder holds."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson

__all__ = ["EXAMPLES", "inspect"]

EXAMPLES = """
urbantwin inspect out/dataset
urbantwin inspect map.osm.pbf
urbantwin inspect drive.mcap:/lidar/points
urbantwin inspect twin/ --json | jq .counts
"""


def inspect(
    path: Annotated[
        Path,
        typer.Argument(
            help="A twin, motion, dataset, report, coverage or sequence; a site.yaml, rig.yaml or "
            "sensor; an OpenStreetMap extract, a DEM, a cloud, a recording or a file of geometry."
        ),
    ],
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Print nothing: only check that it can be read.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Say what any artefact or input holds."""
    Console(quiet=quiet, as_json=as_json).result(ut.inspect(path, progress=not quiet))
