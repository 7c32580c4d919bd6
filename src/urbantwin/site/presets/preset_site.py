"""Initial ``site.yaml`` of a place where a dataset was recorded."""

from __future__ import annotations

import json
import re
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from pyproj import Geod

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.progress import Progress, between, untold
from urbantwin.site.draft import SiteDraft
from urbantwin.site.extract import Extract, Way
from urbantwin.site.extract_file import box_around, read_extract
from urbantwin.site.fetched import FetchedInput
from urbantwin.site.initial_site import init_site
from urbantwin.site.junction_proposal import STREETS
from urbantwin.site.pole_site import PoleChoice, PoleGround, PolePosition, nearest_place
from urbantwin.site.presets.preset import Preset
from urbantwin.site.region import FARTHEST_ANCHOR_M, circle

__all__ = [
    "check_place",
    "init_preset_site",
    "needs_extract",
    "per_hour_of_presence",
    "place_of_preset",
    "street_corner",
    "where_extracts_are",
]

#: Assumed mean speed within view of a junction, waiting included, m/s: an actor of half the speed
#: is in view twice as long, so half as many per hour give as many boxes.
_SPEED_MPS = {"pedestrian": 1.3, "bicycle": 4.0}
_MOTOR_MPS = 6.0
#: Classes of motor traffic.
_MOTOR = ("car", "van", "truck", "bus", "motorcycle")
#: Signs of east and north in each quarter.
_QUARTERS = {
    "north-east": (1, 1), "north-west": (-1, 1), "south-west": (-1, -1), "south-east": (1, -1),
}  # fmt: skip
#: Largest distance of two streets' carriageways that count as meeting, metres.
_MEET_M = 20.0
#: Tags that name a street.
_NAMES = ("name", "name:en", "int_name", "official_name", "alt_name", "old_name", "name:zh")


def init_preset_site(  # noqa: PLR0913 - every one is a person's choice
    folder: Path,
    osm: Path,
    preset: Preset,
    *,
    latitude: float | None = None,
    longitude: float | None = None,
    at_junction: bool = False,
    region: Path | None = None,
    radius_m: float | None = None,
    force: bool = False,
    choose_pole: PoleChoice = nearest_place,
    fetched: Sequence[FetchedInput] = (),
    progress: Progress | None = None,
) -> Path:
    """Write the ``site.yaml`` of a preset for an OpenStreetMap extract and return its path.

    Sensors with a published position are placed there; poles of the others are proposed.

    Args:
        folder: folder to write, created if missing.
        osm: the extract.
        preset: the preset.
        latitude: latitude of the anchor, instead of the preset's, degrees.
        longitude: longitude of the anchor, instead of the preset's, degrees.
        at_junction: use the busiest signalised junction of the map instead of the preset's place.
        region: GeoJSON polygon, instead of the preset's circle.
        radius_m: radius of the circle, instead of the preset's, metres.
        force: replace an existing ``site.yaml``.
        choose_pole: chooses the position of a sensor without a published one.
        fetched: inputs fetched for the place, including the extract.
        progress: called with the share done (0..1) and the current task.

    Raises:
        InputError: the place is neither published nor given, or as for `init_site`.
    """
    tell = progress or untold
    why = "As given."
    check_place(preset, latitude, longitude, at_junction=at_junction)
    if latitude is None and not at_junction:
        latitude, longitude, why = place_of_preset(preset, osm, progress=between(tell, 0.0, 0.4))

    def furnished(draft: SiteDraft, ground: PoleGround) -> SiteDraft:
        return _furnished(draft, ground, preset, why if latitude is not None else draft.why,
                          choose_pole)  # fmt: skip

    radius = preset.radius_m if radius_m is None and region is None else radius_m
    return init_site(
        folder,
        osm,
        latitude=latitude,
        longitude=longitude,
        region=region,
        radius_m=radius,
        force=force,
        choose_pole=nearest_place,
        furnish=furnished,
        fetched=fetched,
        progress=between(tell, 0.4, 1.0),
    )


def check_place(
    preset: Preset, latitude: float | None, longitude: float | None, *, at_junction: bool = False
) -> None:
    """Check that a given place is that of the preset, if that is published.

    Raises:
        InputError: it is another place.
    """
    place = preset.place
    if place is None:
        return
    expected = f"a place around {place.latitude:.5f}, {place.longitude:.5f}, or none"
    if at_junction:
        problem = "is given with a preset of which the place is known"
        raise InputError(problem, place="--at-junction", expected=expected)
    if latitude is not None and longitude is not None:
        ends = (place.longitude, place.latitude, longitude, latitude)
        away = float(Geod(ellps="WGS84").inv(*ends)[2])
        if away > place.within_m + FARTHEST_ANCHOR_M:
            shown = f"{away / 1000:.0f} km" if away >= 10_000 else f"{away:.0f} m"
            problem = f"is of a place {shown} from {latitude:g}, {longitude:g}"
            raise InputError(problem, place=f"--preset {preset.name}", expected=expected)


def place_of_preset(
    preset: Preset, osm: Path, *, progress: Progress | None = None
) -> tuple[float, float, str]:
    """Return latitude and longitude of a preset's anchor on a map, and the reason.

    Raises:
        InputError: the place is not published.
    """
    place = preset.place
    if place is None:
        raise InputError(
            "is of an unpublished place",
            place=f"--preset {preset.name}",
            expected="--lat and --lon of a junction that you choose, or --at-junction",
        )
    if place.streets:
        site = SiteFrame(place.latitude, place.longitude)
        near = box_around(site, circle(place.within_m))
        extract = read_extract(osm, near, progress=progress)
        corner = street_corner(extract, site, place.streets, place.within_m)
        names = " and ".join(one[0] for one in place.streets)
        if corner is not None:
            return *corner, f"Where {names} meet on the map."
        why = (
            f"The map does not tell where {names} meet: it is within {place.within_m:g} m of here."
        )
        return place.latitude, place.longitude, why
    why = f"Within {place.within_m:g} m of the true place, by the sources above."
    return place.latitude, place.longitude, why


def needs_extract(preset: Preset) -> InputError:
    """Return the error for a preset without a map."""
    return InputError(
        "needs a map of the place",
        place=f"--preset {preset.name}",
        expected=f"--at LAT,LON of a junction to fetch one, or {where_extracts_are(preset)}",
    )


def where_extracts_are(preset: Preset) -> str:
    """Return advice about the option for an extract of a preset's place, and where to get one."""
    place = preset.place
    get = "its own junction's: https://www.openstreetmap.org/export"
    if place is not None:
        site = SiteFrame(place.latitude, place.longitude)
        box = ",".join(f"{value:.4f}" for value in box_around(site, circle(20.0)))
        get = (
            f"https://www.openstreetmap.org/export#map=17/{place.latitude:.5f}/"
            f"{place.longitude:.5f}, or `osmium extract -b {box} COUNTRY.osm.pbf -o map.osm.pbf`"
        )
    return f"--osm with an extract: {get}"


def _furnished(
    draft: SiteDraft, ground: PoleGround, preset: Preset, why: str, choose_pole: PoleChoice
) -> SiteDraft:
    per_hour, remark = dict(draft.per_hour), ""
    traffic = preset.traffic
    if traffic is not None and traffic.per_hour is not None:
        per_hour, remark = dict(traffic.per_hour), traffic.source
    elif traffic is not None and traffic.boxes_per_frame is not None:
        per_hour = per_hour_of_presence(traffic.boxes_per_frame, per_hour)
        remark = (
            "The map's guess of all motor vehicles, shared out as seen in the recording: "
            + traffic.source
        )
    about = (
        f"The place of {preset.recording} ({preset.homepage}).",
        f"Nothing of the recording is here; its licence is {preset.licence}.",
        "",
        *preset.sources,
        "",
        "Unknown:",
        *(f"- {text}" for text in preset.unknown),
    )
    return replace(
        draft,
        title=preset.title,
        why=why,
        per_hour=per_hour,
        about=about,
        traffic_remark=remark,
        guessed=traffic is None or traffic.per_hour is None,
        rig=_rig(preset, ground, choose_pole),
    )


def _rig(preset: Preset, ground: PoleGround, choose_pole: PoleChoice) -> str:
    """Return the text of the preset's rig with a position for every sensor."""
    parts = re.split(r"(?m)^(?=    - name: )", preset.rig_text)
    poles: dict[str, PolePosition] = {}
    quarter: tuple[int, int] | None = None
    for number, sensor in enumerate(preset.rig.sensors, 1):
        text = parts[number]
        if sensor.is_placed:
            continue
        if sensor.beside is not None:
            beside = poles[sensor.beside]
            east, north, up = json.loads(re.findall(r"offset_m: (\[.*\])", text)[0])
            pole = replace(
                beside,
                east_m=beside.east_m + east,
                north_m=beside.north_m + north,
                height_m=beside.height_m + up,
            )
        else:
            wanted = _QUARTERS.get(sensor.corner or "any")
            if sensor.corner == "opposite" and quarter is not None:
                wanted = -quarter[0], -quarter[1]
            pole = choose_pole(replace(ground, quarter=wanted))
            quarter = (1 if pole.east_m >= 0 else -1, 1 if pole.north_m >= 0 else -1)
            height = re.findall(r"      height_m: (.*)\n", text)
            pole = replace(pole, height_m=float(height[0]) if height else pole.height_m)
        poles[sensor.name] = pole
        fields = {
            "east_m": pole.east_m,
            "north_m": pole.north_m,
            "height_m": pole.height_m,
            "yaw_deg": pole.yaw_deg,
            "pitch_deg": pole.pitch_deg,
            "roll_deg": 0.0,
        }
        lines = "".join(
            f"      {name}: {round(value, 4) + 0.0!r}\n"
            for name, value in fields.items()
            if f"      {name}: " not in text
        )
        text = re.sub(r"      offset_m: .*\n", "", text)
        parts[number] = re.sub(r"      (corner|beside): .*\n", lines, text)
    return "".join(parts)


def per_hour_of_presence(
    boxes_per_frame: Mapping[str, float], guess: Mapping[str, int]
) -> dict[str, int]:
    """Return actors per hour by class: the guessed motor traffic, split by measured shares.

    Args:
        boxes_per_frame: mean number of boxes of each class in a frame.
        guess: actors per hour, guessed from the map; classes without measurement keep it.
    """
    motor = sum(guess.get(name, 0) for name in _MOTOR)
    seen = sum(boxes_per_frame.get(name, 0.0) for name in _MOTOR)
    if not seen:
        return dict(guess)
    shares = {
        name: count
        for name, count in guess.items()
        if name not in boxes_per_frame and name not in _MOTOR
    }
    for name, boxes in boxes_per_frame.items():
        speed = _SPEED_MPS.get(name, _MOTOR_MPS)
        shares[name] = round(motor * boxes / seen * speed / _MOTOR_MPS)
    order = [*guess, *(name for name in shares if name not in guess)]
    return {name: shares[name] for name in order if name in shares}


def street_corner(
    extract: Extract, site: SiteFrame, streets: Sequence[Sequence[str]], within_m: float
) -> tuple[float, float] | None:
    """Return latitude and longitude of the centre of the place where named streets meet.

    Args:
        extract: the map.
        site: frame with its origin at about the streets' meeting place.
        streets: possible beginnings of the name of each street.
        within_m: largest distance of the meeting place from the origin, metres.

    Returns:
        ``None`` if a street is missing, or the streets do not meet within the distance.
    """
    lines = [_lines(extract, site, names, within_m) for names in streets]
    if len(lines) < 2 or not all(lines):
        return None
    first, *rest = (shapely.union_all(one) for one in lines)
    near, crossed = first, first
    for other in rest:
        near = near.buffer(_MEET_M).intersection(other)
        crossed = crossed.intersection(other)
    # Streets on two levels, or that end before each other, have no common point.
    meeting = near if crossed.is_empty else crossed
    parts = [part for part in shapely.get_parts(meeting) if not part.is_empty]
    if not parts:
        return None
    # Dual carriageways cross at several points: those around the nearest one are merged.
    middles = np.array([shapely.get_coordinates(part.centroid)[0] for part in parts])
    nearest = middles[np.argmin(np.linalg.norm(middles, axis=1))]
    middle = middles[np.linalg.norm(middles - nearest, axis=1) <= 2 * _MEET_M].mean(axis=0)
    if float(np.linalg.norm(middle)) > within_m:
        return None
    longitude, latitude = site.lonlat_from_site(middle)[0]
    return round(float(latitude), 7), round(float(longitude), 7)


def _lines(
    extract: Extract, site: SiteFrame, names: Sequence[str], within_m: float
) -> list[shapely.Geometry]:
    """Return the lines of a street near the origin."""
    wanted = [_plain(name) for name in names]
    disc = shapely.Point(0.0, 0.0).buffer(within_m + _MEET_M)
    found = []
    for way in extract.highways():
        if way.tags["highway"] in STREETS and _is_named(way, wanted):
            points = extract.way_line(way, site)
            if len(points) >= 2:
                found.append(shapely.intersection(shapely.LineString(points), disc))
    return [line for line in found if not line.is_empty]


def _is_named(way: Way, wanted: Sequence[str]) -> bool:
    given = [_plain(way.tags[key]) for key in _NAMES if key in way.tags]
    return any(name.startswith(start) for name in given for start in wanted)


def _plain(name: str) -> str:
    """Return a name in lower case, without accents, dots and blanks."""
    letters = unicodedata.normalize("NFKD", name).casefold()
    return re.sub(r"[\s.\-'’]|[\u0300-\u036f]", "", letters)
