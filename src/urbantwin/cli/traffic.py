"""``urbantwin traffic``: a twin's motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet, Seed

__all__ = ["EXAMPLES", "traffic"]

EXAMPLES = """
urbantwin traffic twin/ -o motion/
urbantwin traffic twin/ -o motion/ --seconds 300 --seed 7
urbantwin traffic twin/ -o motion/ --demand tuned/traffic.yaml
urbantwin traffic twin/ -o motion/ --scenario scenario.yaml
urbantwin traffic twin/ -o motion/ --counts counts.csv --time-of-day 08:00
urbantwin traffic twin/ -o motion/ --counts loops.xml --detectors loops.add.xml
"""


def traffic(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out = None,
    seconds: Annotated[
        float | None,
        typer.Option(min=0.1, max=86400.0, help="Length of the motion; the site's if not given."),
    ] = None,
    seed: Seed = None,
    demand: Annotated[
        Path | None,
        typer.Option(help="Fields of `traffic:` that replace the site's: tuned/traffic.yaml."),
    ] = None,
    scenario: Annotated[
        Path | None,
        typer.Option(help="A scenario.yaml: rare events at a place and a time (docs/events.md)."),
    ] = None,
    counts: Annotated[
        Path | None,
        typer.Option(
            help="A table (CSV): approach and turn, or road, or crossing; class, begin, count. Or "
            "what SUMO's detectors write (XML, CSV)."
        ),
    ] = None,
    detectors: Annotated[
        Path | None,
        typer.Option(help="Where the detectors of the counts are: SUMO's additional file."),
    ] = None,
    time_of_day: Annotated[
        str | None,
        typer.Option(metavar="HH:MM", help="When the motion begins; the site's if not given."),
    ] = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Drive a twin's traffic: every actor's pose at every step."""
    made = ut.drive(
        twin,
        out,
        seconds=seconds,
        seed=seed,
        demand=demand,
        scenario=scenario,
        counts=counts,
        detectors=detectors,
        time_of_day=time_of_day,
        pictures=pictures,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
