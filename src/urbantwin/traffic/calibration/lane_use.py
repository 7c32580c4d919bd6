"""Use of an approach's lanes by vehicles of the same movement."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from urbantwin.traffic.calibration.measured import Measured
from urbantwin.traffic.calibration.passages import JunctionLinks

__all__ = ["FEWEST", "LaneUse", "shrunk"]

_Movement = tuple[str, str]
#: Least number of vehicles of a movement.
FEWEST = 20
#: Number of recorded vehicles with the same weight as the usual shares.
_PRIOR_VEHICLES = 20


def shrunk(recorded: float, usual: float, count: int) -> float:
    """Return a recorded value shrunk towards the usual one, with the weight n / (n + 20)."""
    return usual + count / (count + _PRIOR_VEHICLES) * (recorded - usual)


class LaneUse:
    """Shares of the lanes by movement, requested so that the wanted shares result.

    The wanted shares lie between the recorded ones and those of a simulation without requests, the
    first one. Later simulations show how many vehicles do not reach their requested lane.

    Args:
        recorded: the measurement that is fitted to.
        links: the movements over the junction.
    """

    def __init__(self, recorded: Measured, links: JunctionLinks) -> None:
        leads: dict[tuple[str, str], set[str]] = defaultdict(set)
        for lane, leaving in links.ways.values():
            leads[lane.rpartition("_")[0], leaving].add(lane)
        self.recorded: dict[_Movement, dict[str, int]] = {}
        for movement, used in sorted(recorded.lane_use.items()):
            counts = {lane: used.get(lane, 0) for lane in sorted(leads[movement])}
            if len(counts) > 1 and sum(counts.values()) >= FEWEST:
                self.recorded[movement] = counts
        self._usual: dict[_Movement, dict[str, int]] = {}
        self._wanted: dict[_Movement, dict[str, float]] = {}
        self._asked: dict[_Movement, dict[str, float]] = {}
        self._shown: dict[_Movement, dict[str, int]] = {}

    def learn(self, simulated: Measured) -> None:
        """Update the requested shares by a simulation with `rows`."""
        for movement, used in self.recorded.items():
            simulated_use = simulated.lane_use.get(movement, {})
            shown = {lane: simulated_use.get(lane, 0) for lane in used}
            seen, count = sum(shown.values()), sum(used.values())
            if not seen:
                continue
            if movement not in self._wanted:
                self._usual[movement] = shown
                self._wanted[movement] = self._asked[movement] = {
                    lane: shrunk(used[lane] / count, shown[lane] / seen, count) for lane in used
                }
                continue
            self._shown[movement] = shown
            requested = {
                lane: self._asked[movement][lane]
                * ((wanted * seen + 1) / (shown[lane] + 1)) ** (seen / (seen + _PRIOR_VEHICLES))
                for lane, wanted in self._wanted[movement].items()
            }
            self._asked[movement] = {
                lane: weight / sum(requested.values()) for lane, weight in requested.items()
            }

    def rows(self) -> dict[str, list[dict[str, Any]]]:
        """Return ``lanes`` of ``traffic.approaches`` by road."""
        by_road: dict[str, list[dict[str, Any]]] = defaultdict(list)
        for (approach, leaving), requested in self._asked.items():
            shares = {
                lane: round(share, 3) for lane, share in requested.items() if round(share, 3) > 0
            }
            by_road[approach].append({"turn": leaving, "shares": shares})
        return dict(by_road)

    def told(self) -> list[dict[str, Any]]:
        """Return the lane use of each movement: recorded, simulated without and with requests."""
        return [
            {
                "approach": movement[0],
                "turn": movement[1],
                "recorded": self.recorded[movement],
                "simulated_unled": self._usual[movement],
                "simulated": self._shown.get(movement),
            }
            for movement in self._wanted
        ]


def approach_rows(lanes: LaneUse, headways: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return ``traffic.approaches``: the queue headway and lanes of each road."""
    rows = lanes.rows()
    return [
        {
            "approach": road,
            **({"queue_headway_s": headways[road]} if road in headways else {}),
            **({"lanes": rows[road]} if road in rows else {}),
        }
        for road in sorted({*rows, *headways})
    ]
