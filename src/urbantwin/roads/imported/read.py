"""Reading an imported map, in any of the formats, into the site frame."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from mmap import ACCESS_READ, mmap
from pathlib import Path

import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads import argoverse, lanelet2
from urbantwin.roads.imported.streets_between import with_streets_between
from urbantwin.roads.model import LaneModel
from urbantwin.roads.opendrive.reading.placement import placed, shifted
from urbantwin.roads.opendrive.reading.read import ReadMap, read_opendrive

__all__ = [
    "ImportedMap",
    "anchor_of",
    "is_map_of_roads",
    "is_placed",
    "map_format",
    "naming_file",
    "placed_map",
    "read_map",
]

#: File name extensions and their formats.
FORMATS = {".xodr": "OpenDRIVE", ".osm": "Lanelet2", ".json": "Argoverse 2"}
_LANELET = re.compile(rb"""v=["']lanelet["']""")
EXPECTED = "an OpenDRIVE map (.xodr), a Lanelet2 map (.osm) or one of Argoverse 2 (.json)"


@dataclass(frozen=True)
class ImportedMap:
    """A map in the site frame.

    Attributes:
        path: the file.
        model: the lane model.
        notes: what the reader found and assumed.
        heights_at_corners: whether the map has heights at the corners of its lines only, so that
            nothing is known of the road between them, as far apart as a straight street is long.
        drivable: where the map says that vehicles can drive, lanes or not, in plan; empty where
            it does not say.
    """

    path: Path
    model: LaneModel
    notes: dict[str, object] = field(default_factory=dict)
    heights_at_corners: bool = False
    drivable: shapely.Geometry = field(default_factory=shapely.MultiPolygon)


def map_format(path: Path) -> str:
    """Return ``OpenDRIVE``, ``Lanelet2`` or ``Argoverse 2`` by a file's ending.

    Raises:
        InputError: it has another ending.
    """
    found = FORMATS.get(path.suffix.lower())
    if found is None:
        raise InputError("has an unknown ending", file=path, expected=EXPECTED)
    return found


def is_map_of_roads(path: Path) -> bool:
    """Whether a file is a map that we read, and not an OpenStreetMap extract, by a first look.

    Both kinds of ``.osm`` are the same XML; only Lanelet2 has relations of the type ``lanelet``.
    """
    if path.suffix.lower() == ".json":
        return argoverse.is_argoverse(path)
    if path.suffix.lower() != ".osm":
        return path.suffix.lower() in FORMATS
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as text:
            return bool(_LANELET.search(text))
    except (OSError, ValueError):  # an empty file cannot be mapped
        return False


def read_map(
    path: Path, frame: SiteFrame, anchor_m: tuple[float, float] | None = None
) -> ImportedMap:
    """Read a map into the site frame.

    Args:
        path: the file.
        frame: the site frame.
        anchor_m: for a map without georeference: its own x, y of the anchor; x runs east and y
            north. Without it, the map's origin is the anchor.

    Raises:
        InputError: the file cannot be read, or ``anchor_m`` is given for a map that says where
            on earth it is.
    """
    kind = map_format(path)
    if kind == "OpenDRIVE":
        return placed_map(path, read_opendrive(path), frame, anchor_m)
    is_lanelet2 = kind == "Lanelet2"
    reader = lanelet2.read_lanelet2 if is_lanelet2 else argoverse.read_argoverse
    model, found = reader(path, frame)
    drivable = shapely.MultiPolygon() if is_lanelet2 else argoverse.drivable_area(path, frame)
    if anchor_m is not None:
        if is_placed(path):
            raise _placed_twice(path)
        model = shifted(model, (-anchor_m[0], -anchor_m[1], 0.0, 0.0))
        drivable = shapely.transform(drivable, lambda xy: xy - anchor_m)
    return ImportedMap(path, model, {"format": kind, **found}, not is_lanelet2, drivable)


def placed_map(
    path: Path, read: ReadMap, frame: SiteFrame, anchor_m: tuple[float, float] | None = None
) -> ImportedMap:
    """Return an OpenDRIVE map that was read, in the site frame; see ``read_map``."""
    notes: dict[str, object] = {"format": "OpenDRIVE", **read.notes}
    model, between, unfollowed = with_streets_between(read.model)
    if between:
        notes["junctions_joined_directly"] = between
    notes["dropped"] = [*read.notes["dropped"], *unfollowed]  # type: ignore[misc]
    if read.projection is not None:
        if anchor_m is not None:
            raise _placed_twice(path)
        with naming_file(path):
            return ImportedMap(path, placed(model, read.projection, frame), notes)
    x, y = anchor_m or (0.0, 0.0)
    notes["georeference"] = f"none in the map: x east, y north, and {x:g}, {y:g} is the anchor"
    return ImportedMap(path, shifted(model, (-x, -y, 0.0, 0.0)), notes)


@contextmanager
def naming_file(path: Path) -> Iterator[None]:
    """Name the file in errors that do not."""
    try:
        yield
    except InputError as error:
        if error.file:
            raise
        raise InputError(
            error.problem, file=path, place=error.place, expected=error.expected
        ) from None


def anchor_of(path: Path) -> tuple[float, float]:
    """Return latitude and longitude of the middle of a map of lanelets, degrees.

    Raises:
        InputError: it cannot be read, or does not say where on earth it lies.
    """
    if map_format(path) == "Argoverse 2":
        return argoverse.anchor_of(path)
    return lanelet2.anchor_of(path)


def is_placed(path: Path) -> bool:
    """Whether a map of lanelets says where on earth it lies: a Lanelet2 map by its degrees."""
    if map_format(path) == "Argoverse 2":
        return argoverse.is_placed(path)
    try:
        anchor_of(path)
    except InputError:
        return False
    return True


def _placed_twice(path: Path) -> InputError:
    return InputError(
        "says itself where on earth it is",
        file=path,
        place="roads.anchor_m",
        expected="it only for a map without a georeference",
    )
