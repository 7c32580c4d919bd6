"""Flows of classes without counts: pedestrians and bicycles, and vehicles without a counted place.

A demand gives the numbers that enter the whole region; a recording those that come into view. The
share of departures that come into view is estimated by simulations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping

from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import MOTORS, JunctionLinks

__all__ = ["UncountedFlows", "ways_missed"]

#: Share of the vehicles in view that may be uncounted without a note.
_UNCOUNTED_SHARE = 0.1

#: Maximum number of departures per actor in view: further ones have other routes.
_MAX_DEPARTURES_PER_ACTOR = 20.0


class UncountedFlows:
    """Flows per hour of classes without counts, updated by simulations.

    Args:
        recorded: the measurement of the recording.
        counted: classes with counts.
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
        """Correct the flows by a simulation.

        Visible actors are proportional to departures, so that all simulations are used together.
        """
        hours = simulated.seconds / 3600
        for name, wanted in self._wanted.items():
            self._planned[name] += asked.get(name, 0.0) * hours
            self._seen[name] += simulated.new.get(name, 0)
            if self._seen[name]:
                share = self._seen[name] / max(self._planned[name], 1e-9)
                self.per_hour[name] = round(wanted / max(share, 1 / _MAX_DEPARTURES_PER_ACTOR), 1)

    def untold(self) -> list[str]:
        """Return notes on the observed classes without routes on the map."""
        return [
            f"{name}: {self._wanted[name]:.0f} an hour are recorded, and none of "
            f"{planned:.0f} simulated is seen there: the map has no ways for them"
            for name, planned in self._planned.items()
            if planned >= 1 and not self._seen[name]
        ]


def ways_missed(recorded: Measured, links: JunctionLinks, beside: int = 0) -> list[str]:
    """Return notes on recorded motor traffic that is not simulated for want of a route or a count.

    Args:
        recorded: the measurement of the recording.
        links: the movements over the main junction.
        beside: number of other vehicles that were counted elsewhere.
    """
    mapped = {(lane.rpartition("_")[0], leaving) for lane, leaving in links.ways.values()}
    notes = [
        f"{count} vehicles from road {movement[0]} to {movement[1]}: the map has no way there"
        for movement, count in sorted(recorded.turns.items())
        if movement not in mapped
    ]
    appeared = sum(recorded.new.get(name, 0) for name in MOTORS)
    missed = appeared - sum(recorded.turns.values()) - beside
    if missed > _UNCOUNTED_SHARE * appeared:
        notes.append(
            f"{missed} of {appeared} motor vehicles that come into view pass no junction or road "
            "where they could be counted: nobody is simulated in their place, and shares and "
            "speeds are without them"
        )
    return notes
