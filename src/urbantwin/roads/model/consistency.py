"""Consistency of a lane model that was read from a file."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from urbantwin.errors import InputError
from urbantwin.roads.model.lane_section import LANE_KINDS
from urbantwin.roads.model.profile import Profile
from urbantwin.roads.model.road import ModelRoad
from urbantwin.taxonomy import ROAD_USERS

if TYPE_CHECKING:
    from urbantwin.roads.model.model import LaneModel

__all__ = ["check_model"]

#: No road of a site is longer, metres.
_LONGEST_M = 1e6
_PROFILES = ("offset", "elevation", "bank", "crown")


def check_model(model: LaneModel, file: Path) -> None:
    """Refuse a model with references to nothing, or with roads that cannot be drawn.

    Raises:
        InputError: an id is given twice or is of nothing, a curve or a profile has no pieces, a
            road has no lanes or no end; the field is named.
    """
    if model.driving_side not in ("right", "left"):
        raise InputError(
            "is not a side of the road", file=file, place="driving_side", expected="right or left"
        )
    for name in ("roads", "junctions", "areas", "signals", "controllers"):
        ids = [one.id for one in getattr(model, name)]
        if len(set(ids)) < len(ids):
            raise InputError("has an id twice", file=file, place=name)
    roads, junctions = model.road_by_id, model.junction_by_id
    for number, road in enumerate(model.roads):
        _check_road(road, file, f"roads[{number}]")
        _known([road.junction], {-1, *junctions}, file, f"roads[{number}].junction")
    for number, junction in enumerate(model.junctions):
        for index, one in enumerate(junction.connections):
            place = f"junctions[{number}].connections[{index}]"
            _known((one.incoming, one.connecting), roads, file, place)
    for name in ("areas", "signals"):
        for number, item in enumerate(getattr(model, name)):
            _known([item.road], roads, file, f"{name}[{number}].road")
    heads = {one.id for one in model.signals}
    for number, controller in enumerate(model.controllers):
        _known(controller.signals, heads, file, f"controllers[{number}].signals")
        _known(controller.junctions, junctions, file, f"controllers[{number}].junctions")


def _check_road(road: ModelRoad, file: Path, place: str) -> None:
    pieces = road.curve.pieces
    if not pieces or any(len(one.u) not in (0, 4) or len(one.v) != len(one.u) for one in pieces):
        raise InputError("is not a curve", file=file, place=f"{place}.curve", expected="pieces")
    lengths = [one.length for one in pieces]
    if min(lengths) < 0 or sum(lengths) > _LONGEST_M:
        raise InputError("has no length", file=file, place=f"{place}.curve", expected="metres")
    for name in _PROFILES:
        _check_profile(getattr(road, name), file, f"{place}.{name}")
    if not road.sections:
        raise InputError("has no sections", file=file, place=place, expected="one at least")
    starts = [one.s for one in road.sections]
    if starts != sorted(starts):
        raise InputError("has sections out of order", file=file, place=place)
    for number, section in enumerate(road.sections):
        here = f"{place}.sections[{number}]"
        if len(section.by_id) < len(section.lanes) or 0 in section.by_id:
            raise InputError("has lanes without ids of their own", file=file, place=here)
        for index, lane in enumerate(section.lanes):
            if lane.kind not in LANE_KINDS or not set(lane.allowed) <= set(ROAD_USERS):
                raise InputError(
                    f"is of kind {lane.kind[:40]!r} for {', '.join(lane.allowed)[:80]}",
                    file=file,
                    place=f"{here}.lanes[{index}]",
                    expected=f"one of {', '.join(LANE_KINDS)} for classes of actors",
                )
            _check_profile(lane.width, file, f"{here}.lanes[{index}].width")
            if any(k not in section.by_id for k in range(_step(lane.id), lane.id, _step(lane.id))):
                raise InputError("has lanes that do not touch", file=file, place=here)


def _step(identity: int) -> int:
    return 1 if identity > 0 else -1


def _check_profile(profile: Profile, file: Path, place: str) -> None:
    start = profile.start
    if not len(start) or len(start) != len(profile.abcd) or (np.diff(start) < 0).any():
        raise InputError("is not a profile", file=file, place=place, expected="cubics in order")


def _known(wanted: Iterable[int], known: Collection[int], file: Path, place: str) -> None:
    for one in wanted:
        if one not in known:
            raise InputError(f"names {one}, which is not there", file=file, place=place)
