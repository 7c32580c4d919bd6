"""``urbantwin background``: what stands still, measured by a fixed sensor's own frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet

__all__ = ["EXAMPLES", "background"]

EXAMPLES = """
urbantwin background real/ --sensor OS1-128 -o measured.npz
urbantwin background real/ --sensor VLS-128 --columns 1800 -o measured.npz
urbantwin record twin/ motion/ --background measured.npz -o dataset/
"""


def background(
    real: Annotated[
        Path, typer.Argument(help="Frames of a sensor that stands still, in its own frame.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="The .npz to write.")],
    sensor: Annotated[
        str, typer.Option(metavar="MODEL", help="A model of the catalogue, or a sensor's file.")
    ],
    columns: Annotated[
        int | None, typer.Option(min=1, help="Its columns per turn; the default's if not given.")
    ] = None,
    intensity_scale: Annotated[
        float, typer.Option(metavar="X", help="What the data call full scale of intensity.")
    ] = 1.0,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Measure the static world beam by beam from unlabelled frames, for `record --background`."""
    from urbantwin.cli.stages import new_folder
    from urbantwin.fidelity.measured_background import measure_recording

    console = Console(quiet=quiet, as_json=as_json)
    with new_folder(out.parent), console.stage("background") as progress:
        summary = measure_recording(
            real,
            sensor,
            out,
            columns=columns,
            intensity_scale=intensity_scale,
            progress=progress,
        )
    console.result({"path": str(out), **summary})
