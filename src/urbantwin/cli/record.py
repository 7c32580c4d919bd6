"""``urbantwin record``: a labelled dataset of a twin and its motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Pictures, Quiet, Seed, Workers

__all__ = ["EXAMPLES", "record"]

EXAMPLES = """
urbantwin record twin/ motion/ -o dataset/
urbantwin record twin/ motion/ --rig rig.yaml -o dataset/ --workers 4
urbantwin record twin/ motion/ -o dataset/ --start 5 --stop 10
"""


def record(
    twin: Annotated[Path, typer.Argument(help="A twin's folder.")],
    motion: Annotated[Path, typer.Argument(help="The folder of a motion on that twin.")],
    out: Out,
    rig: Annotated[
        Path | None, typer.Option(help="A rig.yaml; the twin's own rig if not given.")
    ] = None,
    start: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="No frame before this time of the motion.")
    ] = 0.0,
    stop: Annotated[
        float | None, typer.Option(min=0.0, metavar="S", help="No frame after this time.")
    ] = None,
    workers: Workers = None,
    seed: Seed = None,
    pictures: Pictures = True,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Record labelled LiDAR frames. Run again after an interruption, it goes on from there."""
    from urbantwin.cli.stages import dataset_pictures_stage, record_stage
    from urbantwin.cli.summary import summary
    from urbantwin.traffic import Motion
    from urbantwin.twin import load_twin

    console = Console(quiet=quiet, as_json=as_json)
    loaded, driven = load_twin(twin), Motion.load(motion)
    record_stage(
        loaded,
        driven,
        rig,
        out,
        console,
        workers=workers,
        seed=seed,
        start_s=start,
        stop_s=stop,
    )
    if pictures:
        dataset_pictures_stage(out, loaded, driven, console)
    console.result(summary(out))
