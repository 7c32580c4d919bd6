"""``urbantwin calibrate``: a site's traffic from recorded tracks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Out, Quiet, Seed

__all__ = ["EXAMPLES", "calibrate"]

EXAMPLES = """
urbantwin calibrate tracks.yaml --site site.yaml -o calibrated/
urbantwin calibrate tracks.csv --site site.yaml -o calibrated/ --fit-share 0.5 --gap 60
urbantwin calibrate observed/ --site site.yaml -o calibrated/
urbantwin traffic twin/ -o motion/ --demand calibrated/traffic.yaml
urbantwin run calibrated/site.yaml -o out/
"""


def calibrate(
    tracks: Annotated[
        Path,
        typer.Argument(
            help="A description of recorded tracks (YAML, docs/recorded_traffic.md), or the "
            "tracks: CSV, OpenLABEL or nuScenes JSON, KITTI labels, OpenSCENARIO; or a folder of "
            "`urbantwin observe`.",
        ),
    ],
    site: Annotated[Path, typer.Option(metavar="FILE", help="The site.yaml.")],
    out: Out = None,
    fit_share: Annotated[
        float,
        typer.Option(min=0.1, max=1.0, help="Share of the recording that is fitted to."),
    ] = 0.6,
    gap: Annotated[
        float, typer.Option(min=0.0, help="Seconds between that and what judges.")
    ] = 5.0,
    seconds: Annotated[
        float,
        typer.Option(min=0.0, max=86400.0, help="Length of the simulation that is judged."),
    ] = 3600.0,
    seed: Seed = None,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Fit a site's demand, drivers and signals to recorded tracks; judge by the rest of them."""
    made = ut.calibrate(
        tracks,
        site,
        out,
        fit_share=fit_share,
        gap=gap,
        seconds=seconds,
        seed=seed,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
