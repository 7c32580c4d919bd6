"""``urbantwin record``: a labelled dataset of a twin and its motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import (
    AsJson,
    OutOrUrl,
    Pictures,
    Quiet,
    Ray,
    Seed,
    SplitGap,
    Thin,
    Workers,
)

__all__ = ["EXAMPLES", "record"]

EXAMPLES = """
urbantwin record twin/ motion/ -o dataset/
urbantwin record twin/ motion/ --rig rig.yaml -o dataset/ --workers 4
urbantwin record twin/ motion/ -o dataset/ --start 5 --stop 10 --every 10
urbantwin record twin/ motion/ -o dataset/ --weather rain --visibility 800
urbantwin record twin/ motion/ -o dataset/ --effects none
urbantwin record twin/ motion/ -o dataset/ --storage zstd
urbantwin record twin/ motion/ -o dataset/ --split 60,20,20 --gap 5 --thin 0.5
urbantwin record twin/ motion/ --rig bus.yaml --ride 12 -o dataset/
urbantwin record twin/ motion/ --nodes nodes.yaml -o fleet/
urbantwin record twin/ motion/ -o dataset/ --backend warp --workers 1
urbantwin record twin/ motion/ -o /shared/dataset/ --ray auto
urbantwin record twin/ motion/ -o s3://bucket/dataset --ray 10.0.0.1:6379
urbantwin record twin/ motion/ -o dataset/ --background corner=a.npz --background pole=b.npz
"""


def record(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    motion: Annotated[Path, typer.Argument(help="The folder of a motion on that twin.")],
    out: OutOrUrl = None,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    nodes: Annotated[
        Path | None,
        typer.Option(help="A nodes.yaml: several rigs, standing and riding, recorded together."),
    ] = None,
    start: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="No frame before this time of the motion.")
    ] = 0.0,
    stop: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="No frame after this time.")
    ] = None,
    every: Annotated[
        int, typer.Option(min=1, metavar="N", help="Only each N-th frame of the rig's rate.")
    ] = 1,
    effects: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help="none, all, and effects to turn on or off: none,noise or no-sun."
        ),
    ] = None,
    weather: Annotated[
        str | None, typer.Option(metavar="NAME", help="clear, rain, fog or snow.")
    ] = None,
    visibility: Annotated[
        float | None, typer.Option(metavar="M", help="How far one sees in that weather.")
    ] = None,
    wet_ground: Annotated[
        float | None, typer.Option(metavar="SHARE", help="0 is dry, 1 a film of water.")
    ] = None,
    sun_elevation: Annotated[
        float | None, typer.Option(metavar="DEG", help="Of the sun above the horizon.")
    ] = None,
    sun_azimuth: Annotated[
        float | None, typer.Option(metavar="DEG", help="Of the sun, clockwise from north.")
    ] = None,
    ride: Annotated[
        str | None,
        typer.Option(metavar="TRACK|CLASS", help="The actor that carries a rig that rides."),
    ] = None,
    fused: Annotated[
        bool | None,
        typer.Option("--fused/--separate", help="One dataset of all sensors, or one for each."),
    ] = None,
    backend: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="What casts the rays: embree, or bvh where it is missing; bvh, built in; warp "
            "(an extra: a CUDA device); warp:DEVICE.",
        ),
    ] = None,
    storage: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Of points: npy, which OpenPCDet reads; zstd, columns in Parquet, nothing lost; "
            "laz, LAS 1.4 in whole millimetres.",
        ),
    ] = "npy",
    split: Annotated[
        str,
        typer.Option(metavar="SHARES", help="Of training, validation and test, cut in time."),
    ] = "70,15,15",
    gap: SplitGap = None,
    thin: Thin = None,
    background: Annotated[
        list[str] | None,
        typer.Option(
            metavar="[NAME=]FILE",
            help="What a real sensor measured of the static world; for each sensor of the rig.",
        ),
    ] = None,
    fuse: Annotated[
        bool,
        typer.Option("--fuse", help="Where nobody looked, the twin is seen."),
    ] = False,
    workers: Workers = None,
    ray: Ray = None,
    seed: Seed = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Record labelled LiDAR frames. Run again after an interruption, it goes on from there."""
    made = ut.record(
        twin,
        motion,
        out,
        rig=rig,
        nodes=nodes,
        start=start,
        stop=stop,
        every=every,
        effects=effects,
        weather=weather,
        visibility=visibility,
        wet_ground=wet_ground,
        sun_elevation=sun_elevation,
        sun_azimuth=sun_azimuth,
        ride=ride,
        fused=fused,
        backend=backend,
        storage=storage,
        split=split,
        gap=gap,
        thin=thin,
        background=background or (),
        fuse=fuse,
        workers=workers,
        ray=ray,
        seed=seed,
        pictures=pictures,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
