"""Who is counted nowhere: people and bicycles, of whom so many set out that as many are seen.

And vehicles that nobody drives: whose way the map does not have, or who pass elsewhere. A demand
says how many come into the whole region; a recording tells how many come into view. How many of
those who set out are seen, simulations tell.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping

from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import MOTORS, JunctionLinks

__all__ = ["UncountedFlows", "ways_missed"]

#: So many of the vehicles in view may pass elsewhere, or in part, before it is told.
_ELSEWHERE = 0.1

#: No more set out for one that is seen than this: the others have other ways.
_MOST_FOR_ONE = 20.0


class UncountedFlows:
    """Flows per hour of classes that no row of counts is for, from simulation to simulation.

    Args:
        recorded: who came into view.
        counted: classes that rows of counts are for.
    """

    def __init__(self, recorded: Measured, counted: Collection[str] = MOTORS) -> None:
        hours = recorded.seconds / 3600
        self._wanted = {
            name: round(count / hours, 1)
            for name, count in recorded.new.items()
            if name not in (*MOTORS, *counted) and count
        }
        self._planned: dict[str, float] = defaultdict(float)
        self._seen: dict[str, int] = defaultdict(int)
        self.per_hour = dict(self._wanted)

    def learn(self, asked: Mapping[str, float], simulated: Measured) -> None:
        """Correct the flows by a simulation of some.

        What is seen is in proportion to what sets out, so that all simulations count together.
        """
        hours = simulated.seconds / 3600
        for name, wanted in self._wanted.items():
            self._planned[name] += asked.get(name, 0.0) * hours
            self._seen[name] += simulated.new.get(name, 0)
            if self._seen[name]:
                share = self._seen[name] / max(self._planned[name], 1e-9)
                self.per_hour[name] = round(wanted / max(share, 1 / _MOST_FOR_ONE), 1)

    def untold(self) -> list[str]:
        """Return which classes are seen and have no ways on the map."""
        return [
            f"{name}: {self._wanted[name]:.0f} an hour are recorded, and none of "
            f"{planned:.0f} simulated is seen there: the map has no ways for them"
            for name, planned in self._planned.items()
            if planned >= 1 and not self._seen[name]
        ]


def ways_missed(recorded: Measured, links: JunctionLinks, beside: int = 0) -> list[str]:
    """Return what is recorded of motor traffic and not simulated, for want of a way or a count.

    Args:
        recorded: who came into view and passed the main junction.
        links: the ways over it.
        beside: how many others came into view and were counted elsewhere.
    """
    there = {(lane.rpartition("_")[0], leaving) for lane, leaving in links.ways.values()}
    told = [
        f"{count} vehicles from road {way[0]} to {way[1]}: the map has no way there"
        for way, count in sorted(recorded.turns.items())
        if way not in there
    ]
    came = sum(recorded.new.get(name, 0) for name in MOTORS)
    missed = came - sum(recorded.turns.values()) - beside
    if missed > _ELSEWHERE * came:
        told.append(
            f"{missed} of {came} motor vehicles that come into view pass no junction or road "
            "where they could be counted: nobody is simulated in their place, and shares and "
            "speeds are without them"
        )
    return told
