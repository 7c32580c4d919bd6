"""The text of a first ``site.yaml``: commented, and complete enough to run as it is."""

from __future__ import annotations

import os
import shutil
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import shapely

from urbantwin.artefact import check_file, overwriting, publish_file, replaced_file, sha256_of
from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.draft_inputs import fetched_lines, fetched_of_kind, map_lines, quoted
from urbantwin.site.fetched import FetchedInput
from urbantwin.site.pole_site import PolePosition
from urbantwin.site.region import (
    FARTHEST_M,
    circle,
    polygon_from_geojson,
    polygon_in_site,
    read_geojson,
)
from urbantwin.site.site import load_site

__all__ = [
    "RADIUS_M",
    "SENSOR",
    "SENSOR_COLUMNS",
    "GivenPlace",
    "SiteDraft",
    "check_target",
    "write_draft",
]

#: The sensor of a first site: its model and its firings per turn.
SENSOR, SENSOR_COLUMNS = "OS1-128", 1024

#: The usual radius of a region, metres.
RADIUS_M = 150.0

_GUESS = """\
  # How many come into the region per hour. These are guesses for midday from the streets' classes
  # and lanes, the country, bus lines and what is around; put counts here if you have them. A class
  # that is not listed has none.
"""
_GUESSED = """\
  guessed: true         # no more come than signals let through; without this line all are tried
"""


@dataclass(frozen=True)
class SiteDraft:
    """What is proposed for a site.

    Attributes:
        title: the site's name.
        why: why the anchor is where it is, a sentence.
        latitude: of the anchor, degrees, WGS84.
        longitude: of the anchor, degrees, WGS84.
        region: a GeoJSON file with the region's polygon, or the radius of a circle, metres.
        osm: the OpenStreetMap extract, if there is one.
        roads: the map of the roads, if there is one.
        anchor_m: its own x, y of the anchor, where it has no georeference.
        per_hour: actors per hour by class.
        pole: where the sensor stands.
        about: sentences about the place for the file's head; empty ones between paragraphs.
        traffic_remark: where ``per_hour`` is from, if it is no guess of the map.
        guessed: whether ``per_hour`` is a guess.
        rig: text of the mapping ``rig``, set in, instead of one sensor on ``pole``.
        fetched: inputs that were fetched, the map among them.
    """

    title: str
    why: str
    latitude: float
    longitude: float
    region: Path | float
    osm: Path | None
    roads: Path | None
    anchor_m: tuple[float, float] | None
    per_hour: Mapping[str, int]
    pole: PolePosition
    about: Sequence[str] = ()
    traffic_remark: str = ""
    guessed: bool = True
    rig: str | None = None
    fetched: tuple[FetchedInput, ...] = ()


@dataclass(frozen=True)
class GivenPlace:
    """Where a new site is to be, as far as it was given.

    Attributes:
        point: latitude and longitude of the anchor, degrees.
        file: a GeoJSON file with the region's polygon.
        polygon: that polygon, longitude and latitude.
        radius_m: radius of a circle in its place.
    """

    point: tuple[float, float] | None
    file: Path | None
    polygon: shapely.Polygon | None
    radius_m: float | None

    @classmethod
    def checked(
        cls,
        latitude: float | None,
        longitude: float | None,
        region: Path | None,
        radius_m: float | None,
    ) -> GivenPlace:
        """Check the given place.

        Raises:
            InputError: a value is out of range, one of a pair is missing, the region is given twice
                or its file is wrong.
        """
        if region is not None and radius_m is not None:
            raise InputError("is given with a radius", file=region, expected="one of the two")
        if radius_m is not None and not 20.0 <= radius_m <= FARTHEST_M:
            raise InputError(f"the radius is {radius_m:g} m", expected=f"20 to {FARTHEST_M:g} m")
        polygon = polygon_from_geojson(read_geojson(region), file=region) if region else None
        if latitude is None and longitude is None:
            return cls(None, region, polygon, radius_m)
        if latitude is None or longitude is None:
            raise InputError("latitude and longitude go together", expected="both or neither")
        for name, value, most in (("latitude", latitude, 90.0), ("longitude", longitude, 180.0)):
            if not -most <= value <= most:
                problem = f"the {name} {value:g} is out of range"
                raise InputError(problem, expected=f"-{most:g} to {most:g}")
        return cls((latitude, longitude), region, polygon, radius_m)

    def region(self, frame: SiteFrame, radius_m: float) -> shapely.Polygon:
        """Return the region in the site frame: the polygon, or a circle of the given radius."""
        if self.polygon is None or self.file is None:
            return circle(radius_m)
        return polygon_in_site(self.polygon, frame, file=self.file)


def check_target(folder: Path, *, force: bool) -> None:
    """Check that a ``site.yaml`` may be written to a folder.

    Raises:
        InputError: there is one already, or the folder is a file or one of our artefacts.
    """
    target = folder / "site.yaml"
    if target.exists() and not force:
        raise InputError("is there already", file=target, expected="a new folder, or --force")
    if folder.exists() and not folder.is_dir():
        raise InputError("is a file", file=folder, expected="a folder")
    with overwriting(allowed=force):
        check_file(target, kind=None)


def write_draft(folder: Path, draft: SiteDraft, *, force: bool) -> Path:
    """Write a draft as ``site.yaml`` and return its path.

    Files that lie outside ``folder`` are copied into it, so that the folder can be passed on.

    Raises:
        InputError: another file of a name is there already.
    """
    target = folder / "site.yaml"
    folder.mkdir(parents=True, exist_ok=True)
    text = _text(folder, draft, force)
    scratch = folder / ".site.yaml.part"
    scratch.write_text(text, encoding="utf-8")
    try:
        load_site(scratch)
        with overwriting(allowed=force):
            publish_file(scratch, Path(os.path.realpath(target)), None, target=target)
    except InputError as error:
        raise InputError(
            error.problem, file=target, place=error.place, expected=error.expected
        ) from None
    finally:
        scratch.unlink(missing_ok=True)
    return target


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
    with overwriting(allowed=force), replaced_file(target, kind=None) as scratch:
        shutil.copyfile(file, scratch)
    return file.name


#: The terms of every extract of OpenStreetMap.
_OSM_TERMS = """\
  licence: ODbL-1.0
  attribution: "© OpenStreetMap contributors"
"""


def _inputs(folder: Path, draft: SiteDraft, force: bool) -> str:
    """Return the lines that name the maps."""
    text = ""
    if draft.osm is not None:
        maps = fetched_of_kind(draft.fetched, "map")
        terms = map_lines(maps[0]) if maps else _OSM_TERMS
        text += f"""\
# The map: .osm, .osm.bz2, .osm.gz or .osm.pbf. Whoever gets the twin is told its terms.
osm:
  file: {quoted(_brought_in(draft.osm, folder, force))}
{terms}
"""
    elif draft.roads is not None:
        text += """\
# Buildings, trees and all else beside the roads, if you have it: an OpenStreetMap extract.
# osm: map.osm

"""
    if draft.roads is not None:
        anchor = ""
        if draft.anchor_m is not None:
            x, y = draft.anchor_m
            anchor = f"""
  # The map does not say where on earth it lies. Its own x (east), y (north) of the anchor:
  anchor_m: [{x:g}, {y:g}]"""
        text += f"""\
# The roads: OpenDRIVE (.xodr) or Lanelet2 (.osm). Whoever gets the twin is told its terms.
roads:
  file: {quoted(_brought_in(draft.roads, folder, force))}
  licence: not stated
  attribution: not stated{anchor}
  driving_side: auto    # auto: as in the map

"""
    return text


def _beside(folder: Path, draft: SiteDraft, force: bool) -> str:
    """Return the lines that name what else a site is made from, or show how."""

    def lines(*kinds: str) -> str:
        return fetched_lines(draft.fetched, lambda file: _brought_in(file, folder, force), *kinds)

    flat = " Flat without it." if draft.roads is None else ""
    elevation = f"""\
# Elevation, if you have it: a GeoTIFF of the bare earth that covers the region.{flat}
# dem:
#   file: dem.tif
#   licence: CC-BY-4.0
#   attribution: "who made it"

"""
    geometry = """\
# Geometry that somebody surveyed or reconstructed, if you have it: 3D Tiles, meshes, airborne
# LiDAR, CityJSON. It takes the place of the map's buildings and trees where it reaches.
# geometry:
#   - file: tiles/tileset.json
#   - file: survey.laz
#     footprints: buildings.gpkg    # outlines of buildings; the map's without it
#     licence: CC-BY-4.0
#     attribution: "who made it"

"""
    imagery = """\
# Pictures of the ground from above, if you have them: they tell paint, asphalt, grass and soil.
# imagery:
#   - file: ortho.tif               # GeoTIFF of red, green and blue
#   - xyz: "https://host/tiles/{z}/{x}/{y}.png"
#     zoom: 19
#     key_env: URBANTWIN_TILES_KEY  # the environment variable that holds the address's key
#     origins: ["https://host2"]    # who else than the address's own host may be asked
"""
    return (
        (lines("elevation") or elevation)
        + lines("buildings")
        + (lines("airborne", "tiles") or geometry)
        + (lines("imagery").removesuffix("\n") or imagery)
    )


def _text(folder: Path, draft: SiteDraft, force: bool) -> str:
    region, pole = draft.region, draft.pole
    outline = (
        f"polygon: {quoted(_brought_in(region, folder, force))}"
        if isinstance(region, Path)
        else f"radius_m: {region:g}"
    )
    inputs, beside = _inputs(folder, draft, force), _beside(folder, draft, force)
    roads = ""
    if draft.roads is None:
        roads = """
# The roads are made from the map. An OpenDRIVE or Lanelet2 map can take their place: file: map.xodr
roads:
  driving_side: auto    # auto, left or right
"""
    loop = """\
# Beyond the region every way out leads back to a way in, so that the same vehicles circulate. With
# false they come in where the region's border cuts a street, and leave where it cuts another.
closed_loop: true
"""
    scene = ""
    if draft.osm is not None:
        scene = """
# Beside the streets: barriers and furniture as mapped, and where the map is silent hedges, walls,
# signs, bins and the like as they usually stand there (typical). Or mapped alone, or none.
scene:
  clutter: typical
"""
    about = "".join(_remark(line) for line in ("", *draft.about)) if draft.about else ""
    counts = "\n".join(f"    {name}: {count}" for name, count in draft.per_hour.items())
    return f"""\
# A site for UrbanTwin. It runs as it is: urbantwin run site.yaml -o out/
# File names are relative to this file. Lengths in metres, angles in degrees, times in seconds.
{about}
name: {quoted(draft.title)}

# The anchor: the origin of the site frame (x east, y north, z above the ground there), WGS84.
# {draft.why}
anchor:
  latitude: {draft.latitude!r}
  longitude: {draft.longitude!r}

# What is built: a circle about the anchor (radius_m), or a polygon: the name of a GeoJSON file
# with longitude, latitude (WGS84). It reaches at most 2000 m from the anchor.
region:
  {outline}

{inputs}{beside}{roads}
# Programs of signals, if you know them; else they are assumed. `urbantwin info` of the twin
# lists its junctions with their streets, approaches and phases.
# signals:
#   - junction: First Street / Second Street
#     cycle: 90           # seconds
#     offset: 0           # after the clock's zero, for green waves
#     phases:
#       - seconds: 40
#         green: [north, south]
#       - green: [east, west]
{scene}
{loop}
traffic:
{_traffic_remark(draft.traffic_remark)}  per_hour:
{counts}
{_GUESSED if draft.guessed else ""}  duration_s: 20        # length of the recorded motion
  warmup_s: 120         # simulated before it, so that the streets are not empty
  step_s: 0.1           # between two steps of the simulation
  seed: 1               # the same seed gives the same traffic

# The sensors, or the name of a file that holds this mapping.
rig:
{draft.rig or _proposed_rig(pole)}"""


def _proposed_rig(pole: PolePosition) -> str:
    """Return the mapping ``rig`` of one sensor on a pole that is proposed."""
    seen = "" if pole.seen is None else f": by the map, {100 * pole.seen:.0f} % is in sight"
    return f"""\
  rate_hz: 10           # frames per second
  frame: level          # of the points: sensor, level (sensor's place and heading, upright) or site
  boxes: track          # of the labels: one size per track, or tight about the mesh at its moment
  sensors:
    # A pole beside the junction, looking at its middle{seen}.
    # More sensors: more items. docs/reference/rig_file.md lists all fields of a rig: heights,
    # timing, echoes, weather, faults, carriers.
    - name: pole
      model: {SENSOR}    # "urbantwin catalogue sensors" lists the models
      columns: {SENSOR_COLUMNS}     # per turn
      east_m: {pole.east_m}
      north_m: {pole.north_m}
      # or, in place of east_m and north_m: latitude and longitude
      height_m: {pole.height_m}     # above the ground there
      yaw_deg: {pole.yaw_deg}    # counter-clockwise from east; or heading_deg, clockwise from north
      pitch_deg: {pole.pitch_deg}    # positive looks down
      roll_deg: 0.0
      proposed: true    # a build moves it to where it sees more; without this line it stays here
      effects:          # all but crosstalk are on unless turned off; effects: false turns off all
        noise: true     # range noise as in the datasheet
        dropout: true   # weak returns are lost
"""


def _traffic_remark(measured: str) -> str:
    """Return the comment on how many come per hour."""
    if not measured:
        return _GUESS
    return _remark(f"How many come into the region per hour. {measured}.", indent="  ")


def _remark(text: str, indent: str = "") -> str:
    """Return a comment of one paragraph."""
    lines = textwrap.wrap(text, 98 - len(indent), break_on_hyphens=False, break_long_words=False)
    return "".join(f"{indent}# {line}\n" for line in lines) or f"{indent}#\n"
