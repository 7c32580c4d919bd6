"""``urbantwin film``: a motion to look at."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

__all__ = ["EXAMPLES", "film"]

EXAMPLES = """
urbantwin film motion/
urbantwin film motion/ -o film.mp4
urbantwin film motion/ -o film.gif --view above --stop 20 --width 640
urbantwin film motion/ -o event.mp4 --at 12,-30 --radius 40 --start 30 --stop 45
"""


def film(
    motion: Annotated[Path, typer.Argument(help="A motion's folder.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="The .mp4 or .gif to write.  [default: film.mp4 or film.gif beside the motion]",
        ),
    ] = None,
    twin: Annotated[
        Path | None, typer.Option(help="The motion's twin; the one beside it if not given.")
    ] = None,
    view: Annotated[str, typer.Option(help="above, corner, or both side by side.")] = "both",
    start: Annotated[float, typer.Option(help="First moment, seconds of the motion.")] = 0.0,
    stop: Annotated[
        float | None, typer.Option(help="Last moment; the end of the motion if not given.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Pictures per second, 0.1 to 50.")] = 10.0,
    speed: Annotated[
        float, typer.Option(help="Seconds of the motion in a second of the film.")
    ] = 1.0,
    width: Annotated[int, typer.Option(help="Of the pictures, pixels.")] = 1280,
    at: Annotated[
        str | None,
        typer.Option(metavar="X,Y", help="Middle of what is shown, metres of the site."),
    ] = None,
    radius: Annotated[
        float | None,
        typer.Option(metavar="M", help="How far around is seen from above; all if not given."),
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Film a motion from above and from a street corner: signals, and actors by class."""
    made = ut.film(
        motion,
        out,
        twin=twin,
        view=view,
        start=start,
        stop=stop,
        fps=fps,
        speed=speed,
        width=width,
        at=at,
        radius=radius,
        overwrite=overwrite,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
