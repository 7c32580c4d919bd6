"""``urbantwin tune``: what is uncertain, fitted to unlabelled real frames."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Layout, Out, Quiet, RowWidth

__all__ = ["EXAMPLES", "tune"]

EXAMPLES = """
urbantwin tune real/ twin/ --rig rig.yaml -o tuned/
urbantwin tune real/ twin/ motion/ --rig rig.yaml -o tuned/ --fit pose,noise,dropout
urbantwin record twin/ motion/ --rig tuned/rig.yaml -o dataset/
"""


class _PointsIn(StrEnum):
    SENSOR = "sensor"
    LEVEL = "level"
    SITE = "site"


def tune(
    real: Annotated[Path, typer.Argument(help="Real frames of the rig, in the order of time.")],
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    out: Out = None,
    motion: Annotated[
        Path | None, typer.Argument(help="A motion on it, to fit the actors of.")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    fit: Annotated[
        str, typer.Option(metavar="LIST", help="What may be fitted.")
    ] = "pose,noise,dropout,reflectivity,actors",
    held_out: Annotated[
        float, typer.Option(metavar="SHARE", help="The last frames, which nothing is fitted to.")
    ] = 0.3,
    trials: Annotated[int, typer.Option(min=1, help="Of each group.")] = 300,
    seed: Annotated[
        int, typer.Option(min=0, help="The number that everything random follows from.")
    ] = 0,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Threads; every number gives the same values.")
    ] = None,
    points_in: Annotated[
        _PointsIn | None,
        typer.Option(help="The frame of the real points.  [default: the rig's]"),
    ] = None,
    layout: Layout = None,
    columns: RowWidth = None,
    report: Annotated[
        bool, typer.Option("--report/--no-report", help="Measure and draw before and after.")
    ] = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Fit what is uncertain of a rig and its actors to unlabelled real frames."""
    made = ut.tune(
        real,
        twin,
        motion,
        out,
        rig=rig,
        fit=fit,
        held_out=held_out,
        trials=trials,
        seed=seed,
        workers=workers,
        points_in=None if points_in is None else points_in.value,
        layout=layout,
        columns=columns,
        report=report,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
