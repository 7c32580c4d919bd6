"""``urbantwin background``: what stands still, measured by fixed sensors' own frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

__all__ = ["EXAMPLES", "background"]

EXAMPLES = """
urbantwin background real/ --sensor OS1-128 -o measured.npz
urbantwin background real/ --sensor VLS-128 --columns 1800 --pose 0 0 0 0 5 0 -o measured.npz
urbantwin background real/ --twin twin/ --rig rig.yaml -o measured.npz
urbantwin background rings/ --twin twin/ --points-in site --interval 1 -o measured.npz
urbantwin background real/ --twin twin/ --only corner --points-in level -o measured.npz
urbantwin background matrix.mat --elevations beams.mat --sensor VLS-128 -o measured.npz
urbantwin record twin/ motion/ --background measured.npz -o dataset/
"""


def background(
    real: Annotated[
        Path,
        typer.Argument(help="Frames of sensors that stand still; or a matrix of ranges."),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The .npz to write.")],
    sensor: Annotated[
        str | None,
        typer.Option(metavar="MODEL", help="A model of the catalogue, or a sensor's file."),
    ] = None,
    columns: Annotated[
        int | None, typer.Option(min=1, help="Its columns per turn; the default's if not given.")
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.1, metavar="HZ", help="Its turns per second.")
    ] = None,
    pose: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z YAW PITCH ROLL",
            help="Of the sensor in the frame of the points, metres and degrees; else it is theirs.",
        ),
    ] = None,
    twin: Annotated[
        Path | None, typer.Option(help="A twin whose rig's sensors they are, in place of --sensor.")
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="With --twin: a rig.yaml; the twin's own if not given.")
    ] = None,
    only: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="With --twin: the sensor that recorded alone."),
    ] = None,
    points_in: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME", help="With --twin: sensor, level or site; else as the rig says."
        ),
    ] = None,
    elevations: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Of a matrix's rows, degrees or radians.")
    ] = None,
    intensity_scale: Annotated[
        float | None, typer.Option(metavar="X", help="What the data call full scale of intensity.")
    ] = None,
    interval: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            metavar="S",
            help="Seconds from frame to frame; a turn if not given. How long a bough stays so.",
        ),
    ] = None,
    traffic: Annotated[
        bool,
        typer.Option("--traffic", help="With --twin: keep what waited on its lanes all the time."),
    ] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure the static world beam by beam from unlabelled frames, for `record --background`."""
    made = ut.background(
        real,
        out,
        sensor=sensor,
        columns=columns,
        rate=rate,
        pose=pose,
        twin=twin,
        rig=rig,
        only=only,
        points_in=points_in,
        elevations=elevations,
        intensity_scale=intensity_scale,
        interval=interval,
        traffic=traffic,
        overwrite=overwrite,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
