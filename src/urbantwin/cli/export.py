"""``urbantwin export``: a twin, a motion or a dataset in other programs' formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Overwrite, Quiet

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
urbantwin export out/dataset/ --to openpcdet -o custom/
urbantwin export out/dataset/ --to openpcdet -o pointpillar.yaml
urbantwin export out/dataset/ --to mmdet3d -o custom/
urbantwin export out/dataset/ --to kitti -o kitti/
urbantwin export out/dataset/ --to semantickitti -o semantickitti/
urbantwin export out/dataset/ --to nuscenes -o nuscenes/
urbantwin export out/dataset/ --to openlabel -o openlabel/
urbantwin export out/dataset/ --to opv2v -o opv2v/
urbantwin export out/dataset/ --to lumpi -o lumpi/
urbantwin export out/dataset/ --to pcd -o clouds/
urbantwin export out/dataset/ --to las -o clouds/
urbantwin export out/dataset/ --to laz -o clouds/
urbantwin export out/dataset/ --to mcap -o drive.mcap
urbantwin export out/dataset/ --to webdataset -o shards/
urbantwin export campaign/ --to parquet -o shards/
urbantwin export out/dataset/ --to challenge -o submission/
"""


def export(
    twin: Annotated[
        Path, typer.Argument(help="A twin, a motion or a dataset; --to says what of which.")
    ],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="FORMAT",
            help="Of a twin: opendrive, carla (a package of a map), sumo (a run that is set up), "
            "geojson (for QGIS: one file, or one per layer in a folder), plan (SVG, PNG), the "
            "scene as glb, obj, ply, usd or fbx, its buildings as cityjson. Of a motion: tracks "
            "(CSV), openlabel, openscenario (ASAM). Of a dataset, to train with: openpcdet and "
            "mmdet3d (with configs for it; openpcdet as a .yaml: the config alone), kitti, "
            "semantickitti, nuscenes, opv2v, lumpi; to look at and carry on: openlabel, pcd, las, "
            "laz, mcap; to stream: webdataset, parquet (of a campaign or a folder of datasets: "
            "shards). Or challenge (a submission to the UrbanTwin challenge). What a "
            "format cannot hold of a dataset is told before it is written.",
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
            help="The file or folder to write.  [default: named after what is exported]",
        ),
    ] = None,
    detections: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="For challenge: what a detector found, as JSON."),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="For challenge: how many frames are submitted.")
    ] = 50,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a twin, a motion or a dataset for other programs, in their formats."""
    made = ut.export(
        twin,
        to,
        out,
        version=version,
        detections=detections,
        frames=frames,
        overwrite=overwrite,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.summary())
