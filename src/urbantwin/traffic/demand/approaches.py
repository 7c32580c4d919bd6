"""How approaches of a site are used, as SUMO's process takes it (``sumo/approaches``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from urbantwin.errors import InputError
from urbantwin.roads import RoadNetwork
from urbantwin.site.yaml_document import nearest

__all__ = ["approaches_of"]


def approaches_of(told: Sequence[Mapping[str, Any]], roads: RoadNetwork) -> dict[str, Any]:
    """Return by road the headway that is kept there, and by next road the shares of its lanes.

    Args:
        told: ``traffic.approaches`` of the site.
        roads: the lanes.

    Raises:
        InputError: there is no such approach or lane.
    """
    lanes_of = {road.id: list(road.lanes) for road in roads.roads}
    found: dict[str, Any] = {}
    for number, one in enumerate(told):
        place = f"traffic.approaches[{number}]"
        if one["approach"] not in lanes_of:
            raise InputError(
                f"there is no road {one['approach']!r:.60}",
                place=f"{place}.approach",
                expected=f"a road's id: {nearest(one['approach'], list(lanes_of))}",
            )
        mine = lanes_of[one["approach"]]
        turns = {}
        for row in one.get("lanes") or ():
            for lane in row["shares"]:
                if lane not in mine:
                    raise InputError(
                        f"the road has no lane {lane!r:.60}",
                        place=f"{place}.lanes",
                        expected=f"its lanes: {nearest(lane, mine)}",
                    )
            whole = sum(row["shares"].values())
            turns[row["turn"]] = {
                lane.rpartition("_")[2]: share / whole for lane, share in row["shares"].items()
            }
        found[one["approach"]] = {"headway_s": one.get("headway_s"), "lanes": turns}
    return found
