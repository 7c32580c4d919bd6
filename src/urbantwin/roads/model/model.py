"""The lane model of a site and its file."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import shapely

from urbantwin.artefact import as_json, write_json
from urbantwin.artefact.typed_document import Pairs, read_typed
from urbantwin.errors import InputError
from urbantwin.geometry import area_union
from urbantwin.roads.model.furniture import RoadArea, RoadSignal, SignalController
from urbantwin.roads.model.lane_section import LANE_KINDS
from urbantwin.roads.model.profile import Profile
from urbantwin.roads.model.road import ModelRoad
from urbantwin.roads.network import CARRIAGEWAY_KINDS
from urbantwin.taxonomy import ROAD_USERS

__all__ = ["Connection", "LaneModel", "ModelJunction", "carriageway_in_plan"]

#: Upper limit of the length of a road, metres.
_LONGEST_M = 1e6
_PROFILES = ("offset", "elevation", "bank", "crown")
STEP_M = 2.0


@dataclass(frozen=True)
class LaneModel:
    """All roads of a site: the source of the mesh, of OpenDRIVE and of SUMO's geometry.

    Attributes:
        driving_side: ``right`` or ``left``. On the right, lanes of negative ids run along the
            reference line; on the left, lanes of positive ids do, unless a lane's ``forward``
            differs.
        roads: streets, and connecting roads through junctions.
        junctions: the junctions of the roads.
        areas: crosswalks, stop lines, islands.
        signals: signal heads and signs.
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
        """Roads by id."""
        return {road.id: road for road in self.roads}

    @cached_property
    def junction_by_id(self) -> dict[int, ModelJunction]:
        """Junctions by id."""
        return {junction.id: junction for junction in self.junctions}

    @property
    def next_id(self) -> int:
        """The lowest id above all that are in use."""
        elements = (self.roads, self.junctions, self.areas, self.signals, self.controllers)
        return 1 + max((item.id for group in elements for item in group), default=0)

    def with_roads(self, roads: tuple[ModelRoad, ...]) -> LaneModel:
        """Return a copy with other roads."""
        return replace(self, roads=roads)

    def save(self, path: Path) -> None:
        """Write the model as JSON at full precision."""
        write_json(path, as_json({"kind": "lane model", **asdict(self)}))

    @classmethod
    def load(cls, path: Path) -> LaneModel:
        """Read a file that ``save`` wrote.

        Raises:
            InputError: the file is missing or is not a lane model; the message names the field.
        """
        model = read_typed(path, cls, "a twin's lane_model.json")
        check_model(model, path)
        return model


@dataclass(frozen=True)
class Connection:
    """A connecting road through a junction.

    Attributes:
        incoming: id of the road that traffic comes from.
        connecting: id of the road that leads through the junction.
        contact: end of the connecting road at the incoming road: ``start`` or ``end``.
        links: pairs of lane ids: of the incoming road, of the connecting road.
    """

    incoming: int
    connecting: int
    contact: str
    links: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class ModelJunction:
    """A junction of roads.

    Attributes:
        id: unique among junctions.
        name: id of the junction in the SUMO network and in ``RoadNetwork``; empty if none yet.
        connections: all connections through it.
        outline: (M, 2) outline in plan, site frame, metres; empty if unknown.
        level: 0 on the ground, 1, 2, ... above other roads.
        members: ids of all junctions of the SUMO network that it combines, including ``name``.
    """

    id: int
    name: str
    connections: tuple[Connection, ...]
    outline: Pairs = field(default_factory=lambda: np.zeros((0, 2)))
    level: int = 0
    members: tuple[str, ...] = ()


def check_model(model: LaneModel, file: Path) -> None:
    """Check ids, references and geometry of a model.

    Raises:
        InputError: an id is repeated or refers to nothing, a curve or a profile has no pieces, or a
            road has no lanes or no length; the message names the field.
    """
    if model.driving_side not in ("right", "left"):
        raise InputError(
            "is not a side of the road", file=file, place="driving_side", expected="right or left"
        )
    for name in ("roads", "junctions", "areas", "signals", "controllers"):
        ids = [item.id for item in getattr(model, name)]
        if len(set(ids)) < len(ids):
            raise InputError("has an id twice", file=file, place=name)
    roads, junctions = model.road_by_id, model.junction_by_id
    for number, road in enumerate(model.roads):
        _check_road(road, file, f"roads[{number}]")
        _known([road.junction], {-1, *junctions}, file, f"roads[{number}].junction")
    for number, junction in enumerate(model.junctions):
        for index, connection in enumerate(junction.connections):
            place = f"junctions[{number}].connections[{index}]"
            _known((connection.incoming, connection.connecting), roads, file, place)
    for name in ("areas", "signals"):
        for number, item in enumerate(getattr(model, name)):
            _known([item.road], roads, file, f"{name}[{number}].road")
    heads = {signal.id for signal in model.signals}
    for number, controller in enumerate(model.controllers):
        _known(controller.signals, heads, file, f"controllers[{number}].signals")
        _known(controller.junctions, junctions, file, f"controllers[{number}].junctions")


def _check_road(road: ModelRoad, file: Path, place: str) -> None:
    pieces = road.curve.pieces
    if not pieces or any(len(p.u) not in (0, 4) or len(p.v) != len(p.u) for p in pieces):
        raise InputError("is not a curve", file=file, place=f"{place}.curve", expected="pieces")
    lengths = [piece.length for piece in pieces]
    if min(lengths) < 0 or sum(lengths) > _LONGEST_M:
        raise InputError("has no length", file=file, place=f"{place}.curve", expected="metres")
    for name in _PROFILES:
        _check_profile(getattr(road, name), file, f"{place}.{name}")
    if not road.sections:
        raise InputError("has no sections", file=file, place=place, expected="one at least")
    starts = [section.s for section in road.sections]
    if starts != sorted(starts):
        raise InputError("has sections out of order", file=file, place=place)
    for number, section in enumerate(road.sections):
        where = f"{place}.sections[{number}]"
        if len(section.by_id) < len(section.lanes) or 0 in section.by_id:
            raise InputError("has lanes without ids of their own", file=file, place=where)
        for index, lane in enumerate(section.lanes):
            if lane.kind not in LANE_KINDS or not set(lane.allowed) <= set(ROAD_USERS):
                raise InputError(
                    f"is of kind {lane.kind[:40]!r} for {', '.join(lane.allowed)[:80]}",
                    file=file,
                    place=f"{where}.lanes[{index}]",
                    expected=f"one of {', '.join(LANE_KINDS)} for classes of actors",
                )
            _check_profile(lane.width, file, f"{where}.lanes[{index}].width")
            if any(k not in section.by_id for k in range(_step(lane.id), lane.id, _step(lane.id))):
                raise InputError("has lanes that do not touch", file=file, place=where)


def _step(identity: int) -> int:
    return 1 if identity > 0 else -1


def _check_profile(profile: Profile, file: Path, place: str) -> None:
    start = profile.start
    if not len(start) or len(start) != len(profile.abcd) or (np.diff(start) < 0).any():
        raise InputError("is not a profile", file=file, place=place, expected="cubics in order")


def _known(wanted: Iterable[int], known: Collection[int], file: Path, place: str) -> None:
    for identity in wanted:
        if identity not in known:
            raise InputError(f"names {identity}, which is not there", file=file, place=place)


def carriageway_in_plan(model: LaneModel, area: shapely.Polygon) -> shapely.Geometry:
    """Return the union of the ground-level lanes for vehicles of roads within 60 m of ``area``."""
    pieces = []
    shapely.prepare(area)
    for road in model.roads:
        if road.level:
            continue
        for section, end in zip(road.sections, road.section_ends, strict=True):
            lanes = [lane for lane in section.lanes if lane.kind in CARRIAGEWAY_KINDS]
            if not lanes or end <= section.s:
                continue
            s = np.linspace(section.s, end, max(2, int((end - section.s) / STEP_M) + 1))
            line = shapely.LineString(road.curve.beside(s, np.zeros(len(s))))
            if not shapely.dwithin(line, area, 60.0):
                continue
            for lane in lanes:
                sides = [
                    road.curve.beside(s, road.border(section, lane, s, outer=outer))
                    for outer in (False, True)
                ]
                strip = shapely.Polygon(np.vstack([sides[0], sides[1][::-1]]))
                pieces.append(shapely.make_valid(strip))
    return area_union([piece for piece in pieces if piece.area > 0])
