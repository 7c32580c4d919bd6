"""Actors at the border of a rig's field of view or of the region: truncation, and what counts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import Pose
from urbantwin.lidar.labels.frame import Whereabouts
from urbantwin.lidar.labels.truncation import Known, StandingActors, truncations
from urbantwin.lidar.outage import dead_beams
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sight.field_of_view import FieldOfView

__all__ = ["Bordering", "Borders"]


class Bordering(NamedTuple):
    """How A actors lie to the borders.

    Attributes:
        truncation: (A,) 0 where one sensor at least has all of an actor in its field of view.
        whereabouts: where each is that does not count, ``None`` for those that do.
    """

    truncation: NDArray[np.float64]
    whereabouts: list[Whereabouts | None]


class Borders:
    """What the sensors of a rig see at all, and where labels count.

    Args:
        sensors: of the rig.
        region: where labels count, site frame; everywhere when not given.
        range_m: and how far from the nearest sensor, in plan; as far as they reach when not given.
    """

    def __init__(
        self,
        sensors: Sequence[MountedSensor],
        region: shapely.Polygon | None = None,
        range_m: float | None = None,
    ) -> None:
        self._range_m = range_m
        self._sensors = tuple(sensors)
        self._region = region
        if region is not None:
            shapely.prepare(region)
        self._fields: list[tuple[NDArray[np.bool_] | None, FieldOfView] | None]
        self._fields = [None] * len(self._sensors)
        self._known: list[Known] = [{} for _ in self._sensors]

    def of(self, time_s: float, poses: Sequence[Pose], actors: StandingActors) -> Bordering:
        """Return the truncation of actors and where they are; of several sensors the best counts.

        Args:
            time_s: of the frame, which decides on outages.
            poses: ``site_SE3_sensor`` of each sensor.
            actors: where they stand.
        """
        count = len(actors.place)
        least, far = np.ones(count), np.ones(count, np.bool_)
        for number, pose in enumerate(poses):
            field = self._field(number, time_s)
            if field is not None:
                share, beyond = truncations(field, pose, actors, self._known[number])
                least, far = np.minimum(least, share), far & beyond
        if self._range_m is not None:
            eyes = np.array([pose.translation[:2] for pose in poses]).reshape(-1, 1, 2)
            away = np.linalg.norm(eyes - actors.place[None, :, :2], axis=2)
            far |= away.min(axis=0, initial=np.inf) > self._range_m
        outside = np.zeros(count, np.bool_)
        if self._region is not None:
            outside = ~shapely.contains_xy(self._region, actors.place[:, 0], actors.place[:, 1])
        return Bordering(
            least,
            [
                "outside" if out else "far" if away else None
                for out, away in zip(outside.tolist(), far.tolist(), strict=True)
            ],
        )

    def _field(self, number: int, time_s: float) -> FieldOfView | None:
        """Return what a sensor sees at a time; ``None`` where it does not work at all."""
        mounted = self._sensors[number]
        dead = dead_beams(mounted, time_s)
        if dead is not None and dead.all():
            return None
        if mounted.sensor.pattern is not None:
            dead = None
        kept = self._fields[number]
        if kept is None or kept[0] is not dead:
            kept = (dead, FieldOfView.of(mounted, dead))
            self._fields[number], self._known[number] = kept, {}
        return kept[1]
