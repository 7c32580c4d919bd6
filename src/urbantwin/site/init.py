"""A first ``site.yaml`` for an extract: commented, and complete enough to run as it is."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from pyproj import Geod

from urbantwin.artefact import sha256_of
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.coverage import mapped_area
from urbantwin.site.extract import Extract, read_extract
from urbantwin.site.junction import STREETS, propose_junction, way_lanes
from urbantwin.site.pole import propose_pole
from urbantwin.site.region import (
    FARTHEST_M,
    circle,
    polygon_from_geojson,
    polygon_in_site,
    read_geojson,
)
from urbantwin.site.site import DEFAULT_PER_HOUR, load_site

__all__ = ["init_site"]

#: The usual radius of a region, and the least that leaves room for traffic to queue, metres.
RADIUS_M, LEAST_RADIUS_M = 150.0, 100.0
#: A region whose circle is mapped to less than this is made smaller.
_MAPPED_SHARE = 0.6
#: Cars per hour that a lane into the region brings; about a quarter of a signalised lane's capacity
#: (900 per hour: 1800 per hour of green, Highway Capacity Manual, for half of the time).
_CARS_PER_LANE = 220.0


@dataclass(frozen=True)
class _Place:
    """Where the anchor is and how it came to be there."""

    latitude: float
    longitude: float
    title: str
    why: str


def init_site(
    folder: Path,
    osm: Path,
    *,
    latitude: float | None = None,
    longitude: float | None = None,
    region: Path | None = None,
    radius_m: float | None = None,
    force: bool = False,
) -> Path:
    """Write a commented ``site.yaml`` for an OpenStreetMap extract and return its path.

    Files that lie outside ``folder`` are copied into it, so that the folder can be passed on.

    Args:
        folder: where to write; made if it is not there.
        osm: the extract.
        latitude: of the anchor, degrees; without it the busiest signalised junction is proposed.
        longitude: of the anchor, degrees.
        region: a GeoJSON polygon; without it a circle.
        radius_m: radius of the circle; without it 150 m, or less where the extract ends before.
        force: replace a ``site.yaml`` that is there.

    Raises:
        InputError: the extract or the region is wrong, the place is not in the extract, or there
            is a ``site.yaml`` already.
    """
    target = folder / "site.yaml"
    if target.exists() and not force:
        raise InputError("is there already", file=target, expected="a new folder, or --force")
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file", file=folder, expected="a folder")
    if region is not None and radius_m is not None:
        raise InputError("is given with a radius", file=region, expected="one of the two")
    if radius_m is not None and not 20.0 <= radius_m <= FARTHEST_M:
        raise InputError(f"a radius of {radius_m:g} m", expected=f"20 to {FARTHEST_M:g} m")
    extract = read_extract(osm)
    polygon = None
    if region is not None:
        polygon = polygon_from_geojson(read_geojson(region), file=region)
    place = _place(extract, latitude, longitude, polygon)
    frame = SiteFrame(place.latitude, place.longitude)
    if polygon is None:
        radius = _radius(extract, frame) if radius_m is None else radius_m
        shape = circle(radius)
        outline = f"radius_m: {radius:g}"
    else:
        shape = polygon_in_site(polygon, frame, file=region or folder)
    folder.mkdir(parents=True, exist_ok=True)
    osm_name = _brought_in(osm, folder, force)
    if region is not None:
        outline = f"polygon: {_quoted(_brought_in(region, folder, force))}"
    text = _text(place, outline, osm_name, extract, frame, shape)
    scratch = folder / ".site.yaml.part"
    scratch.write_text(text, encoding="utf-8")
    try:
        load_site(scratch)
        scratch.replace(target)
    except InputError as error:
        raise InputError(
            error.problem, file=target, place=error.place, expected=error.expected
        ) from None
    finally:
        scratch.unlink(missing_ok=True)
    return target


def _place(
    extract: Extract,
    latitude: float | None,
    longitude: float | None,
    polygon: shapely.Polygon | None,
) -> _Place:
    if latitude is None and longitude is None:
        found = propose_junction(extract, polygon)
        kind = "signalised " if found.signalised else ""
        lights = (
            f"{found.signals} mapped signals" if found.signals else "no signals in this extract"
        )
        why = f"The busiest {kind}junction that is mapped all around: {found.arms} arms, {lights}."
        title = " / ".join(found.names[:2]) or "Junction"
        return _Place(found.latitude, found.longitude, title, why)
    if latitude is None or longitude is None:
        raise InputError("latitude and longitude go together", expected="both or neither")
    for name, value, most in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
        if not -most <= value <= most:
            raise InputError(f"{name} {value:g} is out of range", expected=f"-{most:g} to {most:g}")
    nodes = np.array(list(extract.nodes.values()))
    here = np.broadcast_to([longitude, latitude], nodes.shape)
    away = float(np.min(Geod(ellps="WGS84").inv(*here.T, *nodes.T)[2]))
    if away > RADIUS_M:
        low, high = np.percentile(nodes, [5, 95], axis=0)
        shown = f"{away / 1000:.0f} km" if away >= 10_000 else f"{away:.0f} m"
        raise InputError(
            f"{latitude:g}, {longitude:g} is {shown} from the extract",
            file=extract.path,
            expected=f"latitude {low[1]:.4f} to {high[1]:.4f}, "
            f"longitude {low[0]:.4f} to {high[0]:.4f}",
        )
    return _Place(latitude, longitude, extract.path.name.split(".")[0], "As given.")


def _radius(extract: Extract, frame: SiteFrame) -> float:
    """Return the usual radius, or less where the extract ends before."""
    area = mapped_area(extract, frame)
    for radius in np.arange(RADIUS_M, LEAST_RADIUS_M, -10.0):
        disc = circle(float(radius))
        if shapely.intersection(area, disc).area >= _MAPPED_SHARE * disc.area:
            return float(radius)
    return LEAST_RADIUS_M


def _brought_in(file: Path, folder: Path, force: bool) -> str:
    """Return the file's name relative to the folder, after copying it in where it is outside."""
    if file.resolve().is_relative_to(folder.resolve()):
        return file.resolve().relative_to(folder.resolve()).as_posix()
    target = folder / file.name
    if target.exists():
        if target.is_file() and sha256_of(target) == sha256_of(file):
            return file.name
        if not force or not target.is_file():
            raise InputError(
                f"differs from {file}", file=target, expected="a new folder, or --force"
            )
    scratch = folder / f".{file.name}.part"
    shutil.copyfile(file, scratch)
    scratch.replace(target)
    return file.name


def _per_hour(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> dict[str, int]:
    """Return plausible volumes: cars by the lanes that lead in, the rest in usual proportions."""
    lanes = 0.0
    for way in extract.highways():
        line = extract.way_line(way, frame)
        if way.tags["highway"] in STREETS and len(line) >= 2:
            crossed = shapely.intersection(shapely.LineString(line), region.exterior)
            lanes += way_lanes(way) / 2 * len(shapely.get_coordinates(crossed))
    cars = float(np.clip(lanes * _CARS_PER_LANE, 200.0, 2000.0))
    scale = cars / DEFAULT_PER_HOUR["car"]
    return {
        name: max(10, round(count * scale / 10) * 10) for name, count in DEFAULT_PER_HOUR.items()
    }


def _quoted(text: str) -> str:
    # A JSON string is a YAML string, whatever is in it.
    return json.dumps(text, ensure_ascii=not text.isprintable())


def _text(
    place: _Place,
    outline: str,
    osm_name: str,
    extract: Extract,
    frame: SiteFrame,
    region: shapely.Polygon,
) -> str:
    volumes = _per_hour(extract, frame, region)
    counts = "\n".join(f"    {name}: {count}" for name, count in volumes.items())
    pole = propose_pole(extract, frame)
    return f"""\
# A site for UrbanTwin. It runs as it is: urbantwin run site.yaml -o out/
# File names are relative to this file. Lengths in metres, angles in degrees, times in seconds.

name: {_quoted(place.title)}

# The anchor: the origin of the site frame (x east, y north, z above the ground there), WGS84.
# {place.why}
anchor:
  latitude: {place.latitude!r}
  longitude: {place.longitude!r}

# What is built: a circle about the anchor (radius_m), or a polygon: the name of a GeoJSON file
# with longitude, latitude (WGS84). It reaches at most 2000 m from the anchor.
region:
  {outline}

# The map: .osm, .osm.bz2, .osm.gz or .osm.pbf. Whoever gets the twin is told its terms.
osm:
  file: {_quoted(osm_name)}
  licence: ODbL-1.0
  attribution: "© OpenStreetMap contributors"

# Elevation, if you have it: a GeoTIFF of the bare earth that covers the region. Flat without it.
# dem:
#   file: dem.tif
#   licence: CC-BY-4.0
#   attribution: "who made it"

roads:
  driving_side: auto    # auto, left or right

traffic:
  # How many set out per hour in the whole region. These are guesses from the number of lanes;
  # put counts here if you have them. A class that is not listed has none.
  per_hour:
{counts}
  duration_s: 20        # length of the recorded motion
  warmup_s: 120         # simulated before it, so that the streets are not empty
  step_s: 0.1           # between two steps of the simulation
  seed: 1               # the same seed gives the same traffic

# The sensors, or the name of a file that holds this mapping.
rig:
  rate_hz: 10           # frames per second
  frame: level          # of the points: sensor, level (sensor's place and heading, upright) or site
  sensors:
    # A pole at a corner of the junction, looking at its middle. More sensors: more items.
    - name: pole
      model: OS1-128    # "urbantwin sensors" lists the models
      columns: 1024     # per turn
      east_m: {pole.east_m}
      north_m: {pole.north_m}
      # or, in place of east_m and north_m: latitude and longitude
      height_m: 5.5     # above the ground there
      yaw_deg: {pole.yaw_deg}    # heading, counter-clockwise from east
      pitch_deg: 5.0    # positive looks down
      roll_deg: 0.0
      effects:
        noise: true     # range noise as in the datasheet
        dropout: true   # weak returns are lost
"""
