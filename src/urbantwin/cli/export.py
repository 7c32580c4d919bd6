"""``urbantwin export``: a twin in other programs' formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet

__all__ = ["EXAMPLES", "export"]

EXAMPLES = """
urbantwin export twin/ --to opendrive -o map.xodr
urbantwin export twin/ --to opendrive --version 1.4 -o carla.xodr
urbantwin export twin/ --to carla -o carla/
urbantwin export twin/ --to sumo -o sumo/ && sumo-gui -c sumo/twin.sumocfg
urbantwin export twin/ --to geojson -o layers/
urbantwin export twin/ --to geojson -o lanes.geojson
urbantwin export twin/ --to plan -o plan/
urbantwin export twin/ --to plan -o plan.svg
urbantwin export twin/ --to glb -o scene.glb
urbantwin export twin/ --to obj -o scene.obj
urbantwin export twin/ --to ply -o scene.ply
urbantwin export twin/ --to usd -o scene.usd
urbantwin export twin/ --to fbx -o scene.fbx
urbantwin export twin/ --to cityjson -o buildings.city.json
urbantwin export out/motion/ --to tracks -o tracks.csv
urbantwin export out/motion/ --to openlabel -o openlabel.json
urbantwin export out/motion/ --to openscenario -o traffic.xosc
urbantwin export out/dataset/ --to challenge -o submission/
urbantwin export out/dataset/ --to openpcdet -o pointpillar.yaml
"""


def export(
    twin: Annotated[
        Path, typer.Argument(help="A twin; for challenge, a dataset; for tracks, a motion.")
    ],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="opendrive, carla (a package of a map), sumo (a run that is set up) or "
            "geojson (for QGIS: one file, or one per layer in a folder), plan (SVG, PNG), or the "
            "scene as glb, obj, ply, usd, fbx, or its buildings as cityjson; a motion as tracks "
            "(CSV), openlabel or openscenario (ASAM OpenLABEL, OpenSCENARIO XML); or a dataset's "
            "frames as a submission to the UrbanTwin challenge (challenge), or an OpenPCDet config "
            "with its statistics (openpcdet).",
        ),
    ],
    version: Annotated[
        str | None,
        typer.Option("--version", help="Of OpenDRIVE: 1.8, or 1.4 for CARLA.  [default: 1.8]"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="PATH",
            help="The file or folder to write.  [default: named after the twin]",
        ),
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="For challenge: what a detector found, as JSON."),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="For challenge: how many frames are submitted.")
    ] = 50,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a twin for other programs: OpenDRIVE, CARLA, SUMO, GeoJSON, a plan, 3D scenes."""
    made = ut.export(
        twin,
        to,
        out,
        version=version,
        detections=detections,
        frames=frames,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
