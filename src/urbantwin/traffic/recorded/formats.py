"""Readers of tracks in formats that are not tables."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.artefact.document import read_json_value
from urbantwin.errors import InputError
from urbantwin.number_text import finite_number
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.track import RecordedRows

__all__ = [
    "RowList",
    "kitti_rows",
    "nuscenes_rows",
    "openlabel_rows",
    "openscenario_rows",
    "yaw_of_quaternion",
]

_UNKNOWN = (math.nan, math.nan, math.nan)


@dataclass
class RowList:
    """Rows collected from a file."""

    file: Path
    expected: str
    rows: list[tuple[str, float, str, float, float, float, float, float, float, float]] = field(
        default_factory=list
    )
    places: list[str] = field(default_factory=list)

    def add(
        self,
        place: str,
        track: str,
        time_s: float,
        kind: str,
        xyz: Sequence[float],
        yaw: float = math.nan,
        size: Sequence[float] = _UNKNOWN,
    ) -> None:
        """Add a row; ``place`` is its place in the file.

        Raises:
            InputError: a number is missing or invalid.
        """
        numbers = (time_s, *xyz, yaw, *size)
        if len(xyz) != 3 or len(size) != 3 or not all(_is_number(number) for number in numbers):
            raise self.error(place, "holds something else than numbers")
        if not all(math.isfinite(number) for number in (time_s, *xyz[:2])):
            raise self.error(place, "has a number that is not finite")
        self.places.append(place)
        x, y, z = map(float, xyz)
        length, width, height = map(float, size)
        self.rows.append(
            (str(track), float(time_s), str(kind), x, y, z, float(yaw), length, width, height)
        )

    def error(self, place: str, problem: str) -> InputError:
        """Return the error to raise for a place in the file."""
        return InputError(problem, file=self.file, place=place, expected=self.expected)

    def made(self) -> RecordedRows:
        """Return the rows in order of time.

        Raises:
            InputError: there are none.
        """
        if not self.rows:
            raise InputError("has no tracks", file=self.file, expected=self.expected)
        rows = sorted(
            zip(self.rows, self.places, strict=True), key=lambda row_and_place: row_and_place[0][1]
        )
        columns = list(zip(*(row for row, _ in rows), strict=True))
        numbers = np.array(columns[3:], np.float64)
        places = [place for _, place in rows]
        return RecordedRows(
            self.file,
            np.array(columns[0], object),
            np.array(columns[1], np.float64),
            np.array(columns[2], object),
            numbers[:3].T,
            numbers[3],
            numbers[4:].T,
            lambda row: places[row],
        )


def yaw_of_quaternion(w: float, x: float, y: float, z: float) -> float:
    """Return the heading of a quaternion, rad: of its x axis in plan."""
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


_KITTI_FORMAT = "a label file of KITTI tracking: 17 fields a line, 18 with a score"
_KITTI_FIELDS = (17, 18)
_KITTI_RATE_HZ = 10.0  # KITTI's rate


def kitti_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks of a stationary sensor.

    A line is frame, track, type, truncation, occlusion, alpha, box in the image (4), height, width,
    length, x, y, z of the bottom's centre, rotation about y (KITTI development kit, tracking,
    readme). The camera's frame has x right, y down, z ahead. The result has x ahead, y left;
    ``pose:`` of a description gives the pose of that frame in the site.

    Raises:
        InputError: the file is missing, or a line is invalid.
    """
    try:
        lines = path.read_bytes().decode("utf-8").splitlines()
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=_KITTI_FORMAT) from None
    except (OSError, UnicodeDecodeError):
        raise InputError("is not readable text", file=path, expected=_KITTI_FORMAT) from None
    rows, rate_hz = RowList(path, _KITTI_FORMAT), spec.rate_hz or _KITTI_RATE_HZ
    for number, line in enumerate(lines, 1):
        fields = line.split()
        if not fields:
            continue
        place = f"line {number}"
        if len(fields) not in _KITTI_FIELDS:
            raise rows.error(place, f"has {len(fields)} fields")
        values = [finite_number(fields[k]) for k in (0, 1, *range(10, 17))]
        frame, track, height, width, length, right, down, ahead, turned = (
            math.nan if value is None else value for value in values
        )
        if track < 0:  # "DontCare" has no track
            continue
        if math.isnan(sum((frame, track, height, width, length, right, down, ahead, turned))):
            raise rows.error(place, "holds something else than numbers")
        yaw = -turned - math.pi / 2
        size = (length, width, height)
        name, xyz = str(int(track)), (ahead, -right, -down)
        rows.add(place, name, frame / rate_hz, fields[2], xyz, yaw, size)
    return rows.made()


_NUSCENES_FORMAT = (
    "nuScenes: sample_annotation.json or a tracking submission, with sample.json beside it"
)
_MICROSECOND_S = 1e-6


def nuscenes_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks from ``sample_annotation.json`` or from a tracking submission.

    Times are from ``sample.json`` beside it; without it samples have the file's order and the rate
    ``rate_hz``. Classes of annotations are those of ``instance.json`` and ``category.json``. Sizes
    are width, length, height, rotations w, x, y, z (nuScenes, "Database schema"; "Tracking task",
    results format).

    Raises:
        InputError: a file is missing or not in the format; the message names the entry.
    """
    rows = RowList(path, _NUSCENES_FORMAT)
    whole = read_json_value(path, _NUSCENES_FORMAT)
    if isinstance(whole, dict) and isinstance(whole.get("results"), dict):
        items = [
            (f"results.{sample}[{k}]", item, "tracking_id")
            for sample, sample_items in whole["results"].items()
            for k, item in enumerate(sample_items if isinstance(sample_items, list) else [None])
        ]
        kinds: dict[str, str] = {}
    elif isinstance(whole, list):
        items = [(f"[{k}]", item, "instance_token") for k, item in enumerate(whole)]
        kinds = _kinds(path.parent)
    else:
        raise InputError("is neither", file=path, expected=_NUSCENES_FORMAT)
    samples = [str(item.get("sample_token")) for _, item, _ in items if isinstance(item, dict)]
    times = _times(path.parent, samples, spec, rows)
    for place, item, key in items:
        if not isinstance(item, dict):
            raise rows.error(place, "is no annotation")
        for name, count in (("translation", 3), ("size", 3), ("rotation", 4)):
            value = item.get(name)
            if not isinstance(value, list) or len(value) != count:
                raise rows.error(f"{place}.{name}", f"is not {count} numbers")
            if not all(isinstance(number, int | float) for number in value):
                raise rows.error(f"{place}.{name}", "holds something else than numbers")
        sample, track = str(item.get("sample_token")), item.get(key)
        if sample not in times:
            raise rows.error(f"{place}.sample_token", f"{sample[:40]!r} is not in sample.json")
        if track is None:
            raise rows.error(f"{place}.{key}", "is missing")
        kind = item.get("tracking_name") or item.get("category_name") or kinds.get(str(track))
        if kind is None:
            raise rows.error(place, "has no class: instance.json and category.json are not there")
        width, length, height = item["size"]
        yaw = yaw_of_quaternion(*item["rotation"])
        xyz, size = item["translation"], (length, width, height)
        rows.add(place, str(track), times[sample], str(kind), xyz, yaw, size)
    return rows.made()


def _times(folder: Path, samples: list[str], spec: TracksSpec, rows: RowList) -> dict[str, float]:
    """Return sample -> time, seconds."""
    if (folder / "sample.json").is_file():
        by_token = _table(folder / "sample.json")
        return {
            token: float(row.get("timestamp", 0)) * _MICROSECOND_S
            for token, row in by_token.items()
        }
    if spec.rate_hz is None:
        raise rows.error("sample_token", "sample.json is not beside it, and there is no rate_hz")
    return {token: k / spec.rate_hz for k, token in enumerate(dict.fromkeys(samples))}


def _kinds(folder: Path) -> dict[str, str]:
    """Return instance -> name of its category, if the tables exist."""
    if not (folder / "instance.json").is_file() or not (folder / "category.json").is_file():
        return {}
    names = {token: str(row.get("name")) for token, row in _table(folder / "category.json").items()}
    return {
        token: names.get(str(row.get("category_token")), "unknown")
        for token, row in _table(folder / "instance.json").items()
    }


def _table(path: Path) -> dict[str, dict[str, Any]]:
    """Return a table of nuScenes by its tokens."""
    whole = read_json_value(path, _NUSCENES_FORMAT)
    if not isinstance(whole, list) or not all(
        isinstance(row, dict) and isinstance(row.get("token"), str) for row in whole
    ):
        raise InputError("is no table of nuScenes", file=path, expected="rows with tokens")
    return {row["token"]: row for row in whole}


_OPENLABEL_FORMAT = "ASAM OpenLABEL 1.0 with cuboids"
_CUBOID_VALUES = (9, 10)


def openlabel_rows(path: Path, spec: TracksSpec) -> RecordedRows:
    """Read tracks from OpenLABEL.

    A cuboid's values are x, y, z of its centre, a quaternion x, y, z, w or angles about x, y, z,
    and its sizes along x, y, z (ASAM OpenLABEL 1.0.0, 7.4.5 "Cuboid"). Frames have times
    (``frame_properties.timestamp``: seconds, or a date), or the rate ``rate_hz``.

    Raises:
        InputError: the file is missing or no OpenLABEL; the message names object and frame.
    """
    whole = read_json_value(path, _OPENLABEL_FORMAT)
    rows = RowList(path, _OPENLABEL_FORMAT)
    top = whole.get("openlabel") if isinstance(whole, dict) else None
    frames = top.get("frames") if isinstance(top, dict) else None
    if not isinstance(top, dict) or not isinstance(frames, dict):
        raise rows.error("openlabel.frames", "is missing")
    kinds = {
        name: str(item["type"])
        for name, item in _mapping(top.get("objects")).items()
        if isinstance(item, dict) and "type" in item
    }
    for number, frame in frames.items():
        place = f"openlabel.frames.{number}"
        time_s = _time(rows, place, number, _mapping(frame), spec)
        for name, item in _mapping(_mapping(frame).get("objects")).items():
            data = _mapping(_mapping(item).get("object_data"))
            cuboid = data.get("cuboid")
            first = cuboid[0] if isinstance(cuboid, list) and cuboid else cuboid
            values = _mapping(first).get("val")
            if values is None:
                continue
            cuboid_place = f"{place}.objects.{name}.object_data.cuboid"
            if not isinstance(values, list) or len(values) not in _CUBOID_VALUES:
                raise rows.error(cuboid_place, "has not 9 or 10 values")
            if not all(isinstance(number, int | float) for number in values):
                raise rows.error(cuboid_place, "holds something else than numbers")
            if len(values) == _CUBOID_VALUES[1]:
                yaw = yaw_of_quaternion(values[6], *values[3:6])
            else:
                yaw = float(values[5])
            kind = kinds.get(name) or str(data.get("type", "unknown"))
            rows.add(cuboid_place, name, time_s, kind, values[:3], yaw, values[-3:])
    return rows.made()


def _time(rows: RowList, place: str, number: str, frame: dict[str, Any], spec: TracksSpec) -> float:
    stamp = _mapping(frame.get("frame_properties")).get("timestamp")
    if spec.rate_hz is None and stamp is not None:
        try:
            value = float(stamp)
        except (TypeError, ValueError):
            pass
        else:
            if math.isfinite(value):
                return value
        try:
            date = datetime.datetime.fromisoformat(str(stamp))
        except ValueError:
            problem = f"has the time {str(stamp)[:40]!r}"
            raise rows.error(f"{place}.frame_properties.timestamp", problem) from None
        return (date.replace(tzinfo=date.tzinfo or datetime.UTC)).timestamp()
    if spec.rate_hz is None:
        raise rows.error(place, "has no time, and the description no rate_hz")
    if not number.isdigit():
        raise rows.error(place, "is not a frame's number")
    return int(number) / spec.rate_hz


def _mapping(value: object) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


_OPENSCENARIO_FORMAT = "ASAM OpenSCENARIO XML with polylines of timed world positions"


def openscenario_rows(
    path: Path, spec: TracksSpec, *, without_story: str | None = None
) -> RecordedRows:
    """Read the trajectories of objects (``FollowTrajectoryAction`` with a ``Polyline``).

    A position is that of the object's reference point; the centre of its box is offset by the
    ``Center`` of the object's ``BoundingBox`` (ASAM OpenSCENARIO XML 1.3, "BoundingBox").

    Args:
        path: the file.
        spec: the description; not used.
        without_story: name of a ``Story`` to skip.

    Raises:
        InputError: the file is missing, invalid, or has positions of other kinds; the message names
            the element's line.
    """
    del spec
    rows = RowList(path, _OPENSCENARIO_FORMAT)
    try:
        root = etree.parse(
            path, etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
        ).getroot()
    except OSError:
        raise InputError("not found", file=path, expected=_OPENSCENARIO_FORMAT) from None
    except etree.XMLSyntaxError as error:
        line = f"line {error.lineno}"
        raise InputError(
            "is not XML", file=path, place=line, expected=_OPENSCENARIO_FORMAT
        ) from None
    bodies = {
        str(element.get("name")): _body(element, rows)
        for element in root.iterfind("Entities/ScenarioObject")
    }
    for group in root.iter("ManeuverGroup", "Private"):
        story = next(group.iterancestors("Story"), None)
        if without_story is not None and story is not None and story.get("name") == without_story:
            continue
        names = [ref.get("entityRef") for ref in group.iterfind("Actors/EntityRef")]
        if group.tag == "Private":
            names = [group.get("entityRef")]
        for vertex in group.iter("Vertex"):
            place = f"line {vertex.sourceline}"
            world = vertex.find("Position/WorldPosition")
            time_s = finite_number(vertex.get("time"))
            if world is None or time_s is None:
                raise rows.error(place, "is not a WorldPosition with a time")
            x, y = finite_number(world.get("x")), finite_number(world.get("y"))
            z, yaw = finite_number(world.get("z", "nan")), finite_number(world.get("h", "nan"))
            if x is None or y is None:
                raise rows.error(place, "has no x and y")
            for name in names:
                if name not in bodies:
                    raise rows.error(place, f"moves {str(name)[:40]!r}, which is no ScenarioObject")
                kind, size, centre = bodies[name]
                facing = math.nan if yaw is None else yaw
                turned = 0.0 if yaw is None else yaw
                middle = (
                    x + centre[0] * math.cos(turned) - centre[1] * math.sin(turned),
                    y + centre[0] * math.sin(turned) + centre[1] * math.cos(turned),
                    math.nan if z is None else z,
                )
                rows.add(place, name, time_s, kind, middle, facing, size)
    return rows.made()


def _body(
    item: etree._Element, rows: RowList
) -> tuple[str, tuple[float, ...], tuple[float, float]]:
    """Return an object's class, its size, and the offset of its box's centre."""
    kind = "unknown"
    for name in ("vehicleCategory", "pedestrianCategory", "miscObjectCategory"):
        values = item.xpath(f".//@{name}")
        if values:
            kind = str(values[0])
    box = item.find(".//BoundingBox")
    if box is None:
        return kind, (math.nan, math.nan, math.nan), (0.0, 0.0)
    place = f"line {box.sourceline}"
    sides, centre = box.find("Dimensions"), box.find("Center")
    if sides is None or centre is None:
        raise rows.error(place, "has not Center and Dimensions")
    size = [finite_number(sides.get(name)) for name in ("length", "width", "height")]
    middle = [finite_number(centre.get(name)) for name in ("x", "y")]
    if None in (*size, *middle):
        raise rows.error(place, "holds something else than numbers")
    return (
        kind,
        tuple(float(side_m or 0.0) for side_m in size),
        (middle[0] or 0.0, middle[1] or 0.0),
    )
