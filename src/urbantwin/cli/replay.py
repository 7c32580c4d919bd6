"""``urbantwin replay``: recorded tracks as a motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet

__all__ = ["EXAMPLES", "replay"]

EXAMPLES = """
urbantwin replay tracks.yaml --twin twin/ -o motion/
urbantwin replay tracks.csv --twin twin/ -o motion/
urbantwin replay openlabel.json --twin twin/ -o motion/ --no-smooth
urbantwin replay tracks.yaml --twin twin/ -o motion/ --step 0.05
"""


def replay(
    tracks: Annotated[
        Path,
        typer.Argument(
            help="A description of recorded tracks (YAML, docs/recorded_traffic.md), or the "
            "tracks: CSV, OpenLABEL or nuScenes JSON, KITTI labels, OpenSCENARIO.",
        ),
    ],
    twin: Annotated[Path, typer.Option(metavar="FOLDER", help="The twin that they move on.")],
    out: Out = None,
    step: Annotated[
        float | None,
        typer.Option(min=0.001, max=10.0, help="Seconds between steps; the site's if not given."),
    ] = None,
    smooth: Annotated[
        bool, typer.Option("--smooth/--no-smooth", help="Take the noise off their paths.")
    ] = True,
    keep_clock: Annotated[
        bool,
        typer.Option("--keep-clock", help="Note when the recording began by its clock."),
    ] = False,
    keep_names: Annotated[
        bool,
        typer.Option("--keep-names", help="Note what it calls actors, also what is no number."),
    ] = False,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Make a motion of recorded tracks: resampled, smoothed, on the twin's ground."""
    made = ut.replay(
        tracks,
        twin,
        out,
        step=step,
        smooth=smooth,
        keep_clock=keep_clock,
        keep_names=keep_names,
        pictures=pictures,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
