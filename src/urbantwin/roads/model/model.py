"""The lane model of a site, and its file."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import read_json, write_json
from urbantwin.errors import InputError
from urbantwin.roads.model.curve import Curve, Piece
from urbantwin.roads.model.furniture import RoadArea, RoadSignal, SignalController
from urbantwin.roads.model.junction import Connection, ModelJunction
from urbantwin.roads.model.profile import Profile
from urbantwin.roads.model.road import ModelRoad, RoadLink
from urbantwin.roads.model.section import LaneSection, SectionLane

__all__ = ["LaneModel"]

_PROFILES = ("offset", "elevation", "bank", "crown")


@dataclass(frozen=True)
class LaneModel:
    """All roads of a site: the source of the mesh, of OpenDRIVE and of SUMO's geometry.

    Attributes:
        driving_side: ``right`` or ``left``. On the right, lanes of negative ids run along the
            reference line; on the left, lanes of positive ids do, unless a lane says otherwise.
        roads: streets and the ways through junctions.
        junctions: where they meet.
        areas: crosswalks, stop lines, islands.
        signals: heads and signs.
        controllers: signal programs.
    """

    driving_side: str
    roads: tuple[ModelRoad, ...]
    junctions: tuple[ModelJunction, ...] = ()
    areas: tuple[RoadArea, ...] = ()
    signals: tuple[RoadSignal, ...] = ()
    controllers: tuple[SignalController, ...] = ()

    @cached_property
    def road_by_id(self) -> dict[int, ModelRoad]:
        """Every road by its id."""
        return {road.id: road for road in self.roads}

    @cached_property
    def junction_by_id(self) -> dict[int, ModelJunction]:
        """Every junction by its id."""
        return {junction.id: junction for junction in self.junctions}

    @property
    def next_id(self) -> int:
        """An id that nothing has yet."""
        everything = (self.roads, self.junctions, self.areas, self.signals, self.controllers)
        return 1 + max((item.id for group in everything for item in group), default=0)

    def with_roads(self, roads: tuple[ModelRoad, ...]) -> LaneModel:
        """Return the model with other roads."""
        return replace(self, roads=roads)

    def save(self, path: Path) -> None:
        """Write the model as JSON, every number in full."""
        write_json(path, _plain({"kind": "lane model", **asdict(self)}))

    @classmethod
    def load(cls, path: Path) -> LaneModel:
        """Read what ``save`` wrote.

        Raises:
            InputError: the file is missing or is not a lane model.
        """
        value = read_json(path, kind="lane model")
        try:
            return cls(
                value["driving_side"],
                tuple(_road(row) for row in value["roads"]),
                tuple(_junction(row) for row in value["junctions"]),
                tuple(
                    RoadArea(**{**r, "corners": _points(r, "corners", 3)}) for r in value["areas"]
                ),
                tuple(_signal(row) for row in value["signals"]),
                tuple(
                    SignalController(**{**_tuples(r), "phases": tuple(map(tuple, r["phases"]))})
                    for r in value["controllers"]
                ),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"is not a lane model ({error})", file=path, expected="a twin's lane_model.json"
            ) from None


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _tuples(row: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(item) if isinstance(item, list) else item for key, item in row.items()}


def _points(row: dict[str, Any], key: str, columns: int) -> NDArray[np.float64]:
    return np.array(row[key], np.float64).reshape(-1, columns)


def _profile(row: dict[str, Any]) -> Profile:
    return Profile(np.array(row["start"], np.float64), _points(row, "abcd", 4))


def _road(row: dict[str, Any]) -> ModelRoad:
    fields = _tuples(row)
    fields["curve"] = Curve(tuple(Piece(**_tuples(piece)) for piece in row["curve"]["pieces"]))
    for name in _PROFILES:
        fields[name] = _profile(row[name])
    fields["sections"] = tuple(_section(section) for section in row["sections"])
    for name in ("predecessor", "successor"):
        fields[name] = RoadLink(**row[name]) if row[name] else None
    return ModelRoad(**fields)


def _section(row: dict[str, Any]) -> LaneSection:
    lanes = tuple(
        SectionLane(**{**_tuples(lane), "width": _profile(lane["width"])}) for lane in row["lanes"]
    )
    return LaneSection(**{**row, "lanes": lanes})


def _signal(row: dict[str, Any]) -> RoadSignal:
    return RoadSignal(
        **{**_tuples(row), "value": math.nan if row["value"] is None else row["value"]}
    )


def _junction(row: dict[str, Any]) -> ModelJunction:
    connections = tuple(
        Connection(**{**item, "links": tuple(map(tuple, item["links"]))})
        for item in row["connections"]
    )
    return ModelJunction(
        **{**_tuples(row), "connections": connections, "outline": _points(row, "outline", 2)}
    )
