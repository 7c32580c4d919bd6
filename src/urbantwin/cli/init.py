"""``urbantwin init``: a commented site.yaml that runs as it is."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import urbantwin as ut
from urbantwin.cli.console import Console
from urbantwin.cli.options import AllowKey, KeyEnv

__all__ = ["EXAMPLES", "init"]

EXAMPLES = """
urbantwin init mysite/ --at 48.1374,11.5755
urbantwin init mysite/ --place "Marienplatz and Weinstraße, München" --radius 120
urbantwin init mysite/ --osm map.osm.pbf
urbantwin init mysite/ --osm map.osm --lat 60.1699 --lon 24.9384 --radius 120
urbantwin init mysite/ --osm map.osm --at-junction --region area.geojson
urbantwin init mysite/ --roads map.xodr
urbantwin init mysite/ --roads lanelets.osm --osm map.osm.pbf
urbantwin init map.xodr -o mysite/
urbantwin init --list-presets
urbantwin init s110/ --preset tumtraf-s110
urbantwin init s110/ --preset tumtraf-s110 --osm garching.osm.pbf
"""


def _list_presets(context: typer.Context, wanted: bool) -> None:
    if wanted:
        known = ut.presets()
        if context.params.get("as_json"):
            Console(as_json=True).result(known.summary())
        else:
            print("\n".join(known.names) if context.params.get("quiet") else known)
        raise typer.Exit


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
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="A place at which a dataset was recorded: anchor, region, sensors and traffic as "
            "far as they are published. Without --osm its inputs are fetched.",
        ),
    ] = None,
    list_presets: Annotated[
        bool,
        typer.Option("--list-presets", callback=_list_presets, help="List them, and no more."),
    ] = False,
    at: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON",
            help="Fetch the inputs of this place from public sources (docs/acquire.md).",
        ),
    ] = None,
    place: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Or of this one: 'street and street, town'."),
    ] = None,
    use: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Ask only these sources: names, with commas between."),
    ] = None,
    also: Annotated[
        str | None,
        typer.Option(metavar="NAMES", help="Ask these sources beside the usual ones."),
    ] = None,
    sources: Annotated[
        Path | None, typer.Option(metavar="FILE", help="A table of sources of your own.")
    ] = None,
    cache: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where answers are kept; your own cache without it."),
    ] = None,
    offline: Annotated[
        bool, typer.Option("--offline", help="Ask nobody: take what the cache holds.")
    ] = False,
    key_env: KeyEnv = None,
    allow_key: AllowKey = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a site.yaml.")] = False,
    # First of all, since the list is printed before the others are looked at.
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", is_eager=True, help="Print nothing but errors.")
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            is_eager=True,
            help="Print one JSON document on stdout and nothing else there.",
        ),
    ] = False,
) -> None:
    """Write a commented site.yaml for a place on a map, or for any place on earth."""
    made = ut.init(
        folder,
        osm=osm,
        roads=roads,
        out=out,
        lat=lat,
        lon=lon,
        at_junction=at_junction,
        radius=radius,
        region=region,
        preset=preset,
        at=at,
        place=place,
        use=use,
        also=also,
        sources=sources,
        cache=cache,
        offline=offline,
        key_env=key_env,
        allow_key=allow_key,
        force=force,
        progress=not quiet,
    )
    Console(quiet=quiet, as_json=as_json).result(made.proposal())
