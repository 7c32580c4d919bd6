"""``urbantwin view``: a page to look at."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

__all__ = ["EXAMPLES", "view"]

EXAMPLES = """
urbantwin view out/dataset
urbantwin view out/dataset --save page.html --frames 0:20
urbantwin view real/ out/dataset --report out/report
urbantwin view out/dataset --detections detections/
"""


def view(
    path: Annotated[
        Path,
        typer.Argument(help="A twin, motion, dataset, real frames, detections or report."),
    ],
    other: Annotated[
        Path | None, typer.Argument(help="Frames to show beside them, with one camera.")
    ] = None,
    save: Annotated[
        Path | None,
        typer.Option(
            "--save", "-o", metavar="PAGE.html", help="Write one file, which needs no network."
        ),
    ] = None,
    frames: Annotated[
        str | None,
        typer.Option(metavar="A:B", help="From frame A to before B, counted from 0."),
    ] = None,
    every: Annotated[int, typer.Option(help="Only each N-th frame.")] = 1,
    detections: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Boxes with scores, shown over the labels."),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Of compare: its worst places are listed."),
    ] = None,
    twin: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="The twin; the one beside if not given.")
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="The motion; the one beside if not given."),
    ] = None,
    port: Annotated[int, typer.Option(help="Of the server; 0 for any that is free.")] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the desktop's browser.")
    ] = True,
    rerun: Annotated[
        Path | None, typer.Option(metavar="FILE.rrd", help="Write a recording for rerun.")
    ] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Look at a twin, a motion, a dataset, real frames, or two of them, in a browser."""
    shown = ut.look(
        path,
        other,
        save=save,
        frames=frames,
        every=every,
        detections=detections,
        report=report,
        twin=twin,
        motion=motion,
        port=port,
        browser=browser,
        rerun=rerun,
        overwrite=overwrite,
        progress=not quiet,
    )

    def tell() -> None:
        Console(quiet=quiet, as_json=as_json).result(shown.summary())
        sys.stdout.flush()

    shown.wait(tell)
