"""Resolution of overlaps between actors: around, aside, or later, where possible."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.progress import Progress, between
from urbantwin.traffic.assets import Asset
from urbantwin.traffic.paths.bending import vehicles
from urbantwin.traffic.paths.box_plan import PlanBoxes
from urbantwin.traffic.paths.crowd import Crossings, crowd_walked
from urbantwin.traffic.paths.kept_ways import KeptWays
from urbantwin.traffic.paths.obstacles import Blocks
from urbantwin.traffic.paths.separation import Moving, separated
from urbantwin.traffic.paths.stretches import LeftOff, Stretch, Ways
from urbantwin.traffic.paths.track_box import track_size
from urbantwin.traffic.paths.trajectory import steered
from urbantwin.traffic.paths.walked_ground import WalkedGround
from urbantwin.traffic.paths.yielding import Before, yielded

__all__ = ["STANDING_MS", "Parted", "rear_of"]

#: Speed below which an actor stands, m/s.
STANDING_MS = 0.15
#: Progress of a turn after which pedestrians are done, and lateral offsets of vehicles.
_AFTER_PEDESTRIANS, _AFTER_OFFSETS = 0.35, 0.65
_ROUNDS = 2  # number of times that vehicles avoid pedestrians, who avoid waiting vehicles
#: Time for which delayed pedestrians let vehicles pass at a crossing without a signal, and at
#: green, before vehicles wait for them, seconds.
_PATIENCE_S = (15.0, 4.0)

Columns = dict[str, NDArray[Any]]


class Parted:
    """All actors of a motion, resolved stretch by stretch.

    Args:
        ways: paths of all actors.
        level: (L,) level of each lane.
        blocks: static obstacles.
        solids: outlines of obstacles for pedestrians.
        footway: area that pedestrians prefer.
        step_s: time between steps, seconds.
        asset: returns an asset's dimensions by name.
    """

    def __init__(
        self,
        ways: KeptWays,
        level: NDArray[np.int64],
        blocks: Blocks,
        solids: NDArray[np.object_],
        footway: shapely.Geometry,
        *,
        step_s: float,
        asset: Callable[[str], Asset],
    ) -> None:
        self.level, self.blocks, self.step_s = level, blocks, step_s
        trips, actor_ids = ways.trips, ways.who
        self.meshes = [asset(trip.asset) for trip in trips]
        led = np.array([trip.actor_class == "animal" for trip in trips], np.bool_)
        # Accompanying animals step aside like pedestrians.
        self.classes = tuple(
            "pedestrian" if trip.actor_class == "animal" else trip.actor_class for trip in trips
        )
        self.vehicles = np.where(led, actor_ids, vehicles(actor_ids))
        self.striding = np.array([[x.length, x.width] for x in self.meshes]).reshape(-1, 2)
        self.still = np.array([track_size(mesh)[:2] for mesh in self.meshes]).reshape(-1, 2)
        self.height = np.array([mesh.height for mesh in self.meshes])
        self.walks = np.array([name == "pedestrian" for name in self.classes], np.bool_)
        rear_m = [rear_of(mesh) for mesh in self.meshes]
        columns = ways.columns.opened()
        afoot = np.asarray(columns["xy"][self.walks[columns["trip"]]])
        self.ground = WalkedGround(afoot, blocks.low, solids, footway)
        self.ways = Ways(ways, self.walks, self.classes, self.vehicles, rear_m, step_s)

    def parted(
        self,
        stretch: Stretch,
        left: LeftOff | None,
        before: Before | None,
        crossings: Crossings,
        tell: Progress,
    ) -> Columns:
        """Return the poses of a stretch without overlaps, where possible.

        They have further columns: those of `stretches.WALKS`, and the delay ``behind`` after each
        turn of waiting (N, T).

        Args:
            stretch: the stretch.
            left: states at the end of the previous stretch.
            before: the same traffic up to the moment at which an event changes it.
            crossings: crossings from the first step of the stretch on.
            tell: called with the fraction done (0..1) and what is being done.
        """
        columns = self.ways.within(stretch, left)
        trip, stopped = columns["trip"], columns["speed"] < STANDING_MS
        size = np.where(stopped[:, None], self.still[trip], self.striding[trip])
        boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], size / 2)
        level = self.level[columns["lane"]]
        moving = Moving(
            trip, boxes, columns["speed"], level, columns["lane"], self.classes, self.vehicles
        )
        half, on_foot = self.still[trip] / 2, self.walks[trip]
        afoot = {name: values[on_foot] for name, values in columns.items()}
        begun = stretch.begin if left else None
        if left is not None:
            before = _with_earlier_traffic(left, before)
        delays = []
        for turn in range(_ROUNDS + 1):
            telling = between(tell, turn / (_ROUNDS + 1), (turn + 1) / (_ROUNDS + 1))
            # Pedestrians start each turn from their original paths, since conflicts of one turn may
            # be gone in the next.
            for name, values in afoot.items():
                columns[name][on_foot] = values
            columns = crowd_walked(
                columns, moving, half, self.step_s, self.ground, crossings=crossings,
                patience_s=_PATIENCE_S, left=left, tell=between(telling, 0.0, _AFTER_PEDESTRIANS),
            )  # fmt: skip
            if turn < _ROUNDS:
                separating = between(telling, _AFTER_PEDESTRIANS, _AFTER_OFFSETS)
                columns = self._round_others(columns, moving, size / 2, begun, separating)
            was = before.turn(turn) if before else None
            waiting = between(telling, _AFTER_OFFSETS, 1.0)
            columns = yielded(columns, moving, half, self.step_s, was, waiting)
            delays.append(columns.pop("behind"))
        return {**columns, "behind": np.column_stack(delays)}

    def _round_others(
        self,
        columns: Columns,
        moving: Moving,
        half: NDArray[np.float64],
        begin: int | None,
        tell: Progress,
    ) -> Columns:
        """Return poses in which vehicles have small lateral offsets around others."""
        boxes = PlanBoxes(columns["step"], columns["xy"], columns["yaw"], half)
        now = replace(moving, boxes=boxes, speed=columns["speed"])
        height = self.height[columns["trip"]]
        xy, speed = separated(now, self.blocks, height, self.step_s, columns["aside"], begin, tell)
        lateral_m = columns["aside"] + ((xy - columns["xy"]) * boxes.axes[:, 1]).sum(axis=1)
        return self._steered({**columns, "xy": xy, "speed": speed, "aside": lateral_m}, columns)

    def _steered(self, columns: Columns, was: Columns) -> Columns:
        """Return poses in which changed vehicles have the headings of their new paths."""
        trip, xy = columns["trip"], columns["xy"]
        yaw = columns["yaw"].copy()
        breaks = np.flatnonzero((np.diff(trip) != 0) | (np.diff(columns["step"]) != 1)) + 1
        for rows in np.split(np.arange(len(trip)), breaks):
            number = trip[rows[0]] if len(rows) else 0
            if (xy[rows] != was["xy"][rows]).any() and not self.walks[number]:
                yaw[rows] = steered(xy[rows], yaw[rows], rear_of(self.meshes[number]))
        return {**columns, "yaw": yaw}


def _with_earlier_traffic(left: LeftOff, before: Before | None) -> Before:
    """Return the earlier traffic up to the begin of a stretch, or up to an event within it."""
    earlier = {name: left.columns[name] for name in ("trip", "step")}
    if before is None or before.until <= left.step:
        own, rigid = (before.own, before.rigid) if before else (frozenset[int](), frozenset[int]())
        nothing = np.zeros((len(earlier["trip"]), _ROUNDS + 1))
        return Before(({**earlier, "behind": nothing},), left.step, own, rigid, left.step)
    return replace(before, begin=left.step)


def rear_of(mesh: Asset) -> float:
    """Return the distance of an asset's rear axle behind its centre, metres; 0 without one.

    It is 0 for trams: both bogies are on the rails, as in SUMO's heading.
    """
    if mesh.actor_class == "tram":
        return 0.0
    rear_contacts = mesh.contacts[mesh.contacts[:, 0] < -0.1, 0]
    return -float(rear_contacts.mean()) if len(rear_contacts) else 0.0
