"""``urbantwin carla``: traffic and sensors of a package on a running CARLA server."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet

__all__ = ["EXAMPLES", "carla"]

EXAMPLES = """
urbantwin export twin/ --to carla -o package/
urbantwin carla package/ -o frames/ --seconds 20
urbantwin carla package/ -o frames/ --host 192.168.0.5 --port 2000
"""


def carla(
    package: Annotated[
        Path, typer.Argument(help="What export --to carla wrote; its map is imported in CARLA.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="The folder to write.")],
    host: Annotated[str, typer.Option(help="The server's name.")] = "localhost",
    port: Annotated[int, typer.Option(min=1, max=65535, help="The server's port.")] = 2000,
    seconds: Annotated[float, typer.Option(min=0.05, help="How long, of simulated time.")] = 10.0,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Drive a twin's traffic on a CARLA 0.9.16 server and record it with the twin's rig.

    Needs urbantwin[carla]. It was checked against CARLA's Python classes, not yet on a live server.
    """
    made = ut.carla(package, out, host=host, port=port, seconds=seconds, progress=not quiet)
    Console(quiet=quiet, as_json=as_json).result(made.summary())
