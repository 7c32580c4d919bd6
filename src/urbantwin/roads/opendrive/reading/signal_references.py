"""Reading signal references: signals beside one road that are for another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from lxml import etree

from urbantwin.geometry import wrapped
from urbantwin.roads.model import ModelRoad
from urbantwin.roads.opendrive.reading.parsing import Log, Spot
from urbantwin.roads.opendrive.reading.signals import Sign, read_validity

__all__ = ["Reference", "read_references", "resolve_references"]

#: Turns smaller than this do not matter, radians.
FACING = 1e-3
#: Signals nearer than this to where the reference puts them get no pose of their own, metres.
SAME_M = 0.01


@dataclass(frozen=True)
class Reference:
    """Where the traffic of a road heeds a signal that stands elsewhere."""

    id: str
    s: float
    t: float
    orientation: str
    lanes: tuple[int, ...]


def read_references(item: etree._Element, road: ModelRoad, spot: Spot) -> Iterator[Reference]:
    """Yield the references of a road to signals of others.

    Args:
        item: the ``<road>``.
        road: the same as far as it is read.
        spot: the road, for errors.
    """
    for reference in item.findall("signals/signalReference"):
        here = spot.within(f"signalReference {reference.get('id', '')}")
        with here.dropping():
            s = min(max(here.number(reference, "s"), 0.0), road.length)
            orientation = reference.get("orientation", "none")
            yield Reference(
                reference.get("id", ""),
                s,
                here.number(reference, "t"),
                orientation if orientation in ("+", "-") else "none",
                read_validity(reference, road, s, here),
            )


def resolve_references(
    roads: Mapping[str, ModelRoad],
    signs: Sequence[tuple[str, Sign]],
    references: Sequence[tuple[str, Reference]],
    log: Log,
) -> list[tuple[str, Sign]]:
    """Return signals on the roads that they are for, those that stand elsewhere with their place.

    A signal that is for no lane of its own road is taken to the first road that refers to it.

    Args:
        roads: id in the file -> road.
        signs: road and signal.
        references: road and reference.
        log: the file.
    """
    of: dict[str, list[tuple[str, Reference]]] = {}
    for road, reference in references:
        of.setdefault(reference.id, []).append((road, reference))
    known = {sign.id for _, sign in signs}
    for _ in of.keys() - known:
        log.at("signalReference").remark("references to signals that do not exist")
    result = []
    for number, sign in signs:
        others = of.get(sign.id, [])
        if not others or sign.lanes:
            pose = sign.pose or (_pose(roads[number], sign) if abs(sign.turned) > FACING else ())
            result.append((number, replace(sign, pose=pose)))
            continue
        if len({road for road, _ in others}) > 1:
            log.at(f"signal {sign.id}").remark("references of several roads to one signal")
        road, reference = others[0]
        pose = sign.pose or _pose(roads[number], sign)
        ground = float(roads[road].place(reference.s, reference.t)[0, 2])
        moved = replace(
            sign,
            s=reference.s,
            t=reference.t,
            z=pose[2] - ground,
            orientation=reference.orientation,
            lanes=reference.lanes,
        )
        there = _pose(roads[road], replace(moved, turned=0.0))
        turn = wrapped(pose[3] - there[3])
        same = math.dist(pose[:3], there[:3]) < SAME_M and abs(turn) < FACING
        result.append((road, replace(moved, pose=() if same else pose)))
    return result


def _pose(road: ModelRoad, sign: Sign) -> tuple[float, float, float, float]:
    x, y, z = (float(v) for v in road.place(sign.s, sign.t)[0])
    heading = float(road.curve.at(sign.s)[0, 2]) + sign.turned
    heading += 0.0 if sign.orientation == "-" else math.pi
    return x, y, z + sign.z, wrapped(heading)
