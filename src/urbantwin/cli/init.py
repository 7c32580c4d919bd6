"""``urbantwin init``: a commented site.yaml that runs as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urbantwin.cli.console import Console
from urbantwin.cli.options import AsJson, Quiet
from urbantwin.errors import InputError

__all__ = ["EXAMPLES", "init"]

EXAMPLES = """
urbantwin init mysite/ --osm map.osm.pbf
urbantwin init mysite/ --osm map.osm --lat 60.1699 --lon 24.9384 --radius 120
urbantwin init mysite/ --osm map.osm --at-junction --region area.geojson
urbantwin init mysite/ --roads map.xodr
urbantwin init mysite/ --roads lanelets.osm --osm map.osm.pbf
urbantwin init map.xodr -o mysite/
"""


def init(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="The folder to write site.yaml in; with -o, the map instead."
        ),
    ],
    osm: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="An OpenStreetMap extract: osm, osm.bz2, osm.pbf."),
    ] = None,
    roads: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A map of the roads, used instead of the extract's: OpenDRIVE (xodr) or "
            "Lanelet2 (osm).",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="DIR", help="The folder, where a map comes first."),
    ] = None,
    lat: Annotated[
        float | None, typer.Option(min=-90, max=90, help="The anchor's latitude, degrees, WGS84.")
    ] = None,
    lon: Annotated[
        float | None, typer.Option(min=-180, max=180, help="The anchor's longitude.")
    ] = None,
    at_junction: Annotated[
        bool,
        typer.Option(
            "--at-junction",
            help="Take the busiest signalised junction of the map, which is also what "
            "happens without coordinates.",
        ),
    ] = False,
    radius: Annotated[
        float | None, typer.Option(min=20, help="Region of interest: metres around the anchor.")
    ] = None,
    region: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Region of interest: a GeoJSON polygon.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a site.yaml.")] = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a commented site.yaml for a place on a map."""
    from urbantwin.artefact import new_folder
    from urbantwin.cli.summary import summary
    from urbantwin.roads.imported import init_site_of_map
    from urbantwin.site.initial_site import init_site

    if out is not None:
        folder, osm, roads = _map_first(folder, out, osm, roads)
    if osm is None and roads is None:
        raise InputError("no map is given", place="--osm", expected="--osm or --roads with a file")
    if (lat is None) != (lon is None):
        given, lacking = ("--lat", "--lon") if lon is None else ("--lon", "--lat")
        raise InputError("is alone", place=given, expected=f"{lacking} beside it")
    if at_junction and lat is not None:
        raise InputError(
            "is given with coordinates", place="--at-junction", expected="one of the two"
        )
    console = Console(quiet=quiet, as_json=as_json)
    with new_folder(folder), console.stage("init") as progress:
        if roads is not None:
            path = init_site_of_map(
                folder,
                roads,
                osm=osm,
                latitude=lat,
                longitude=lon,
                region=region,
                radius_m=radius,
                force=force,
                progress=progress,
            )
        elif osm is not None:
            path = init_site(
                folder,
                osm,
                latitude=lat,
                longitude=lon,
                region=region,
                radius_m=radius,
                force=force,
                progress=progress,
            )
    console.result(summary(path))


def _map_first(
    file: Path, folder: Path, osm: Path | None, roads: Path | None
) -> tuple[Path, Path | None, Path | None]:
    """Return folder, extract and map of the roads where a map stands in the folder's place."""
    from urbantwin.roads.imported import is_map_of_roads

    if is_map_of_roads(file):
        if roads is not None:
            raise InputError("is a second map of the roads", file=file, expected="one of the two")
        return folder, osm, file
    if osm is not None:
        raise InputError("is a second extract", file=file, expected="one of the two")
    return folder, file, roads
