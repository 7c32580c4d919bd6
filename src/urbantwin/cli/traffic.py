"""``urbantwin traffic``: a twin's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Seed

__all__ = ["EXAMPLES", "traffic"]

EXAMPLES = """
urbantwin traffic twin/ -o motion/
urbantwin traffic twin/ -o motion/ --seconds 300 --seed 7
"""


def traffic(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=86400.0, help="Length of the motion; the site's if not given."),
    ] = None,
    seed: Seed = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Drive a twin's traffic: every actor's pose at every step."""
    from urbantwin.cli.stages import traffic_stage
    from urbantwin.cli.summary import summary
    from urbantwin.twin import load_twin

    console = Console(quiet=quiet, as_json=as_json)
    traffic_stage(load_twin(twin), out, console, seconds=seconds, seed=seed)
    console.result(summary(out))
