"""Reading a map that somebody made, OpenDRIVE or Lanelet2, into the site frame."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import Curve, LaneModel

__all__ = ["ImportedMap", "map_format", "moved", "read_map"]

#: Endings of the files that we read, and what they hold.
FORMATS = {".xodr": "OpenDRIVE", ".osm": "Lanelet2"}
EXPECTED = "an OpenDRIVE map (.xodr) or a Lanelet2 map (.osm)"


@dataclass(frozen=True)
class ImportedMap:
    """A map in the site frame.

    Attributes:
        path: the file.
        model: the lane model.
        notes: what the reader found and assumed.
    """

    path: Path
    model: LaneModel
    notes: dict[str, object] = field(default_factory=dict)


def map_format(path: Path) -> str:
    """Return ``OpenDRIVE`` or ``Lanelet2`` by a file's ending.

    Raises:
        InputError: it is neither.
    """
    found = FORMATS.get(path.suffix.lower())
    if found is None:
        raise InputError("has an unknown ending", file=path, expected=EXPECTED)
    return found


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
    if map_format(path) == "Lanelet2":
        from urbantwin.roads.lanelet2 import read_lanelet2

        if anchor_m is not None:
            raise _placed_twice(path)
        model, found = read_lanelet2(path, frame)
        return ImportedMap(path, model, {"format": "Lanelet2", **found})
    from urbantwin.roads.opendrive.read import placed, read_opendrive

    model, projection, found = read_opendrive(path)
    notes: dict[str, object] = {"format": "OpenDRIVE", **found}
    if projection is not None:
        if anchor_m is not None:
            raise _placed_twice(path)
        return ImportedMap(path, placed(model, projection, frame), notes)
    origin = anchor_m or (0.0, 0.0)
    notes["georeference"] = (
        f"none in the map: x east, y north, and {origin[0]:g}, {origin[1]:g} is the anchor"
    )
    return ImportedMap(path, moved(model, (-origin[0], -origin[1])), notes)


def moved(model: LaneModel, by: tuple[float, float]) -> LaneModel:
    """Return a lane model moved in plan by x, y metres."""
    if by == (0.0, 0.0):
        return model
    roads = []
    for road in model.roads:
        pieces = tuple(
            dataclasses.replace(piece, x=piece.x + by[0], y=piece.y + by[1])
            for piece in road.curve.pieces
        )
        roads.append(dataclasses.replace(road, curve=Curve(pieces)))
    junctions = tuple(
        dataclasses.replace(junction, outline=junction.outline + np.array(by))
        for junction in model.junctions
    )
    return dataclasses.replace(model, roads=tuple(roads), junctions=junctions)


def _placed_twice(path: Path) -> InputError:
    return InputError(
        "says itself where on earth it is",
        file=path,
        place="roads.anchor_m",
        expected="it only for a map without a georeference",
    )
