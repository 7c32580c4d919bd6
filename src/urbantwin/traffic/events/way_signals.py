"""Signals on a way: whether somebody who goes along it comes to red."""

from __future__ import annotations

import numpy as np

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.events.lane_way import Way
from urbantwin.traffic.motion import Motion

__all__ = ["WaySignals"]


class WaySignals:
    """Whether somebody who goes along a way evenly comes to a red signal.

    Args:
        way: the way.
        place_m: a place on it, metres from its start.
        speed: m/s.
        roads: whose signals there are.
        motion: in which they show something.
    """

    def __init__(
        self, way: Way, place_m: float, speed: float, roads: RoadNetwork, motion: Motion
    ) -> None:
        table = motion.signals.to_pylist()
        self.stops: list[tuple[float, list[list[tuple[float, str]]]]] = []
        for head in roads.signals:
            if head.lane not in way.lanes[:-1]:
                continue
            later_s = (way.station_of(np.array([head.x, head.y])) - place_m) / speed
            shown = [
                [
                    (row["time_s"], row["state"])
                    for row in table
                    if (row["signal"], row["link"]) == (head.program, link)
                ]
                for link in head.links
            ]
            if 0 < later_s * speed + place_m < way.length:
                self.stops.append((later_s, shown))

    def __call__(self, at_s: float) -> str | None:
        """Return what is in the way of who is at the place at a time."""
        for later_s, links in self.stops:
            time_s = at_s + later_s
            if time_s < 0:
                continue  # before the motion
            states = [[state for from_s, state in link if from_s <= time_s] for link in links]
            if not any(link and link[-1] in "Gg" for link in states):
                return f"a signal is not green at {time_s:.1f} s"
        return None
