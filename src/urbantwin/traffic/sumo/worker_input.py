"""Input of SUMO's worker beyond SUMO's own files: gates, speeds in curves, one-lane streets."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urbantwin.roads.curve_speed import REAR_M, SPACING_M, lane_speeds
from urbantwin.roads.sumo_geometry import ONE_LANE
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.sumo.route_file import types_of_reserve

__all__ = ["curves_of", "gates_of", "one_lane_streets"]

#: Highest speed of a vehicle, as a factor of its lane's speed.
_MAX_SPEED_FACTOR = 1.25
#: Edges on which vehicles can wait for others have at least this length, metres.
WAITING_M = 12.0


def gates_of(demand: Demand, until_s: float, seed: int) -> dict[str, Any]:
    """Return the gates of a demand, in the form of ``gates.Gates``.

    Args:
        demand: the demand.
        until_s: end of adding vehicles, SUMO's time.
        seed: SUMO's seed.
    """
    return {
        "gates": [asdict(gate) for gate in demand.gates.gates],
        "parts": [asdict(part) for part in demand.gates.parts],
        "types": types_of_reserve(demand),
        "until_s": until_s,
        "seed": seed,
    }


def curves_of(net_path: Path) -> dict[str, Any]:
    """Return the speeds along each curved lane, in the form of ``curves.Curves``.

    In SUMO a lane has one speed, although a street with a curve is not slow throughout.
    """
    curves: dict[str, Any] = {"spacing_m": SPACING_M, "rear_m": REAR_M, "speeds": {}}
    root = _root_of(net_path)
    if root is None:
        return curves
    limit = {x.get("id", ""): float(x.get("speed", "inf")) for x in root.iterfind("edge/lane")}
    curves["speeds"] = {
        name: np.round(speeds, 2).tolist()
        for name, speeds in lane_speeds(root).items()
        if speeds.min() < _MAX_SPEED_FACTOR * limit[name]
    }
    return curves


def one_lane_streets(net_path: Path) -> dict[str, Any]:
    """Return the streets with one lane for both directions, as ``one_lane.OneLaneStreets`` takes.

    - ``street``: edge -> name of its street, the same for both directions;
    - ``mouths``: edges from which vehicles reach one;
    - ``short``: edges on which vehicles cannot wait for others.
    """
    root = _root_of(net_path)
    if root is None:
        return {}
    street = {
        edge.get("id", ""): min(edge.get("id", ""), note.get("value", ""))
        for edge in root.iterfind("edge")
        for note in edge.iterfind("param")
        if note.get("key") == ONE_LANE
    }
    if not street:
        return {}
    length = {
        edge.get("id", ""): float(edge.find("lane").get("length", "0"))
        for edge in root.iterfind("edge")
        if not edge.get("function")
    }
    short = {edge for edge, metres in length.items() if metres < WAITING_M and edge not in street}
    before: dict[str, set[str]] = {}
    for item in root.iterfind("connection"):
        if item.get("from", "") in length:
            before.setdefault(item.get("to", ""), set()).add(item.get("from", ""))
    mouths: set[str] = set()
    new = set(street)
    while new:
        new = {edge for to in new for edge in before.get(to, ())} - mouths
        mouths |= new
        new &= short
    return {"street": street, "mouths": sorted(mouths), "short": sorted(short)}


def _root_of(net_path: Path) -> Any:  # noqa: ANN401 - an element of lxml, which has no types
    """Return the root of a SUMO network; ``None`` if it is no XML, which SUMO reports."""
    try:
        return etree.parse(net_path).getroot()
    except etree.XMLSyntaxError:
        return None
