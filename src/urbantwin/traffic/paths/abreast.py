"""Groups of pedestrians that walk side by side at one pace.

SUMO simulates only the leader. The others walk beside it where the footway is wide enough, and
behind it elsewhere; in groups of three the leader is in the middle, four form two pairs (Moussaid
et al., PLOS ONE 5, 2010, e10047; Zanlungo and Kanda, CogSci 2013). Waiting groups stand side by
side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from urbantwin.roads import RoadNetwork
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.paths.footing import Footways
from urbantwin.traffic.paths.trajectory import smoothed
from urbantwin.traffic.sumo.simulation import Simulated, with_rows

__all__ = ["with_parties"]

#: Distance between the centres of two pedestrians side by side (to which Moussaid's model is
#: fitted), and of two behind each other, a stride with clearance, metres.
BESIDE_M, BEHIND_M = 0.8, 1.3
#: Tolerance of the footway's or crossing's border, metres.
_BORDER_TOLERANCE_M = 0.1
#: Distance before and after a constriction over which the formation changes, metres.
_FORMATION_CHANGE_M = 2.0
_GRID_M = 0.1
#: Places in a group, in units of the distances above: to the side and behind, by size of the group
#: and member.
_FORMATIONS = {
    2: ((0, 0), (1, 0)),
    3: ((0, 0), (1, 0), (-1, 0)),
    4: ((0, 0), (1, 0), (0, 1), (1, 1)),
}


def with_parties(
    simulated: Simulated, demand: Demand, network: RoadNetwork, step_s: float
) -> Simulated:
    """Return SUMO's output with the other members of groups added.

    Args:
        simulated: SUMO's output.
        demand: the trips that it refers to.
        network: the lanes.
        step_s: time between steps, seconds.
    """
    parties = _parties(demand)
    if not parties:
        return simulated
    new = _followers(simulated, parties, _Walkable(network, simulated.lanes), step_s)
    departed_members = {
        n for leader, all_ in parties.items() if leader in simulated.departed for n in all_
    }
    whole, departed = [simulated], simulated.departed | departed_members
    del simulated
    return replace(with_rows(whole, new), departed=departed)


def _followers(
    simulated: Simulated, parties: dict[int, list[int]], walkable: _Walkable, step_s: float
) -> list[dict[str, NDArray[np.generic]]]:
    """Return the rows of the other members of groups, by leader."""
    by_trip = simulated.by_trip()
    new: list[dict[str, NDArray[np.generic]]] = []
    for leader, followers in parties.items():
        rows = simulated.of_trip(leader, by_trip)
        breaks = np.flatnonzero(np.diff(simulated.step[rows]) != 1) + 1
        for part in np.split(rows, breaks):
            if len(part):
                new += _member_rows(simulated, part, followers, walkable, step_s)
    return new


def _parties(demand: Demand) -> dict[int, list[int]]:
    """Return leader -> other members, by the numbers of their trips."""
    members: dict[int, list[int]] = {}
    for number, trip in enumerate(demand.trips):
        if trip.beside:
            members.setdefault(number - trip.beside, []).append(number)
    return members


def _member_rows(
    simulated: Simulated,
    rows: NDArray[np.int64],
    followers: list[int],
    walkable: _Walkable,
    step_s: float,
) -> list[dict[str, NDArray[np.generic]]]:
    """Return the rows of a group's other members for consecutive rows of its leader."""
    speed = simulated.speed[rows]
    # SUMO moves people to and fro by a metre on walking areas, which the others cannot follow.
    path = smoothed(
        simulated.front[rows],
        simulated.angle_deg[rows],
        speed,
        step_s=step_s,
        length_m=0.0,
        walks=True,
    )
    leader_path = _Way(path.distance_m, path.xy, path.yaw)
    station_m = path.distance_m
    places = _FORMATIONS[len(followers) + 1][1:]
    lane = simulated.lane[rows]
    #: Available width at each point of the path, on the left and on the right.
    room = {
        side: leader_path.smooth(
            walkable.fits(
                lane[leader_path.row], leader_path.place(leader_path.grid, side * BESIDE_M)
            )
        )
        for side in (1, -1)
    }
    wider = 1 if room[1].sum() >= room[-1].sum() else -1
    columns = []
    for rank, (number, (side_sign, rank_behind)) in enumerate(
        zip(followers, places, strict=True), 1
    ):
        side = wider * side_sign
        has_room = (
            np.interp(station_m, leader_path.grid, room[side])
            if side_sign
            else np.ones(len(station_m))
        )
        back = BEHIND_M * (rank_behind + (rank - rank_behind) * (1.0 - has_room) * bool(side_sign))
        own = station_m - back
        columns.append(
            {
                "step": simulated.step[rows],
                "trip": np.full(len(rows), number, simulated.trip.dtype),
                "front": leader_path.place(own, side * BESIDE_M * has_room),
                "angle_deg": simulated.angle_deg[rows],
                "speed": speed,
                "lane": lane[np.searchsorted(station_m, own).clip(0, len(station_m) - 1)],
            }
        )
    return columns


class _Way:
    """The path of a pedestrian, by distance travelled.

    Args:
        at: (N,) distance travelled, metres.
        xy: (N, 2) positions, metres.
        yaw: (N,) headings, rad.
    """

    def __init__(
        self, at: NDArray[np.float64], xy: NDArray[np.float64], yaw: NDArray[np.float64]
    ) -> None:
        self.grid = np.arange(-4 * BEHIND_M, at[-1] + _GRID_M, _GRID_M)
        self.row = np.searchsorted(at, self.grid).clip(0, len(at) - 1)
        distinct, group = np.unique(np.round(at, 2), return_inverse=True)
        x, y, self._yaw = (
            np.interp(self.grid, distinct, np.bincount(group, values) / np.bincount(group))
            for values in (*xy.T, yaw)
        )
        before = np.minimum(self.grid, 0.0)
        self._line = np.column_stack([x + before * np.cos(yaw[0]), y + before * np.sin(yaw[0])])

    def place(
        self, at: NDArray[np.float64], left_m: float | NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return points (N, 2) at a distance along the path and to its left."""
        x, y, yaw = (np.interp(at, self.grid, values) for values in (*self._line.T, self._yaw))
        return np.column_stack([x - left_m * np.sin(yaw), y + left_m * np.cos(yaw)])

    def smooth(self, fits: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the degree of the formation (0..1), smoothed along the path."""
        width = 2 * round(_FORMATION_CHANGE_M / _GRID_M) + 1
        narrow = minimum_filter1d(fits.astype(float), width, mode="nearest")
        return np.asarray(uniform_filter1d(narrow, width, mode="nearest"))


class _Walkable:
    """The area beside pedestrians on a lane that others can walk on.

    Args:
        network: the lanes.
        names: names of lanes, by their indices.
    """

    def __init__(self, network: RoadNetwork, names: Sequence[str]) -> None:
        self._footways = Footways(network, names)
        self._crossings = {
            number: lane.polygon.buffer(_BORDER_TOLERANCE_M)
            for number, name in enumerate(names)
            if (lane := network.lane_by_id.get(name)) is not None and lane.kind == "crossing"
        }

    def fits(self, lane: NDArray[np.integer], xy: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which points (N, 2) beside lanes (N,) are on footways or the lane's crossing."""
        is_walkable = (
            np.nan_to_num(np.hypot(*self._footways.way_in(lane, xy).T)) < _BORDER_TOLERANCE_M
        )
        for number in set(np.unique(lane).tolist()) & self._crossings.keys():
            rows = np.flatnonzero(lane == number)
            is_walkable[rows] = shapely.contains_xy(self._crossings[number], xy[rows])
        return np.asarray(is_walkable)
