"""What a sensor sees of its junction, and the best position for it on a pole."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh, Pose, rotation_from_ypr, ypr_from_rotation
from urbantwin.lidar.rig import MountedSensor
from urbantwin.lidar.sight.cells import LEVEL_M
from urbantwin.lidar.sight.field_of_view import FieldOfView
from urbantwin.lidar.sight.ground import JunctionGround, ground_of_network, pole_places
from urbantwin.lidar.sight.line_of_sight import LineOfSight
from urbantwin.progress import Progress, between, each, untold
from urbantwin.roads import RoadNetwork

__all__ = [
    "CLEAR_M",
    "HEIGHTS_M",
    "NEAR_M",
    "PITCHES_DEG",
    "Candidates",
    "Junction",
    "Junctions",
    "Stance",
    "View",
    "best_view",
    "judged",
    "visible",
]

#: Mounting heights of roadside sensors, metres above the ground.
HEIGHTS_M = (5.5, 6.5, 7.5)
#: Usual pitches, degrees; positive is down.
PITCHES_DEG = (5.0, 10.0, 15.0)
#: Points on objects closer than this are lost for the junction, metres.
NEAR_M = 10.0
#: Least distance of objects other than the sensor's pole, metres.
CLEAR_M = 3.0
#: A sensor within the first distance of the anchor belongs to the anchor's junction, any other to
#: the nearest junction within the second, metres.
_ANCHOR_M, _NEAREST_M = 80.0, 60.0
_LOOKING = "standing the sensors"
#: Positions are first rated by every third point; the best of them by all points.
_ROUGHLY, _FINALISTS = 3, 300
#: Cost of a position, as a share of the junction: per share of near points, for an object that is
#: too close, and per metre beyond the usual distance from the carriageway.
_NEAR_COST, _CLOSE_COST, _OFF_COST, _USUAL_OFF_M = 1.0, 0.5, 0.01, 3.0


class Candidates(NamedTuple):
    """Candidate positions and orientations of a sensor.

    Attributes:
        ground: (N, 3) foot of each pole, site frame.
        off_m: (N,) distance of each from the carriageway.
        heights_m: heights to try at each.
        pitches: pitches to try at each, radians.
        roll: roll of the sensor, radians.
    """

    ground: NDArray[np.float64]
    off_m: NDArray[np.float64]
    heights_m: tuple[float, ...]
    pitches: tuple[float, ...]
    roll: float


class Stance(NamedTuple):
    """A pose of a sensor.

    Attributes:
        place: (3,) site frame.
        height_m: height above the foot of its pole.
        yaw: heading, radians; REP-103, as the next two.
        pitch: positive is down, radians.
        roll: radians.
    """

    place: NDArray[np.float64]
    height_m: float
    yaw: float
    pitch: float
    roll: float

    @classmethod
    def of(cls, mounted: MountedSensor) -> Stance:
        """Return the pose of a mounted sensor."""
        pose: Pose = mounted.site_SE3_sensor
        yaw, pitch, roll = (float(x) for x in ypr_from_rotation(pose.rotation))
        return cls(pose.translation, mounted.sway_height_m, yaw, pitch, roll)

    def written(self) -> dict[str, float]:
        """Return the fields of a rig's sensor, without roll: metres and degrees."""
        return {
            "east_m": round(float(self.place[0]), 2),
            "north_m": round(float(self.place[1]), 2),
            "height_m": self.height_m,
            "yaw_deg": round(float(np.degrees(self.yaw)), 1),
            "pitch_deg": round(float(np.degrees(self.pitch)), 1),
        }


@dataclass(frozen=True, eq=False)
class View:
    """What a sensor sees.

    Attributes:
        stance: pose of the sensor.
        sees: (M,) visible points of the junction's ground.
        near: share (0..1) of its points on objects, not ground, within `NEAR_M`.
        nearest_m: distance to the nearest object.
        score: rating among positions at the junction.
    """

    stance: Stance
    sees: NDArray[np.bool_]
    near: float
    nearest_m: float
    score: float

    @property
    def seen(self) -> float:
        """Visible share (0..1) of the junction."""
        return float(self.sees.mean()) if len(self.sees) else 0.0


def best_view(
    candidates: Candidates,
    ground: JunctionGround,
    around: LineOfSight,
    field: FieldOfView,
    tell: Progress = untold,
) -> View:
    """Return the best of all positions, heights and pitches; the first of equals.

    Args:
        candidates: at least one.
        ground: ground to be seen.
        around: obstacles.
        field: field of view of the sensor.
        tell: called with the fraction done (0..1) and a description.
    """
    rated: list[tuple[float, Stance, float]] = []
    rough = replace(ground, points=ground.points[::_ROUGHLY])
    costs = _OFF_COST * np.maximum(0.0, candidates.off_m - _USUAL_OFF_M)
    places = list(zip(candidates.ground, costs.tolist(), strict=True))
    for foot, cost in each(places, between(tell, 0.0, 0.8), _LOOKING):
        toward = ground.middle - foot[:2]
        yaw = float(np.arctan2(toward[1], toward[0]))
        for height_m in candidates.heights_m:
            place = foot + [0.0, 0.0, height_m]
            free = around.sees(place, rough.points) & _in_range(place, rough, field)
            for pitch in candidates.pitches:
                stance = Stance(place, height_m, yaw, pitch, candidates.roll)
                lit = _lit(stance, free & _within(stance, rough, field), rough, field)
                rated.append((round(lit - cost, 6), stance, cost))
    # Rounded, so that the order does not depend on the last bit.
    rated.sort(key=lambda one: -one[0])
    views = [
        judged(stance, ground, around, field, cost=cost)
        for _, stance, cost in each(rated[:_FINALISTS], between(tell, 0.8, 1.0), _LOOKING)
    ]
    return max(views, key=lambda one: round(one.score, 6))


def judged(
    stance: Stance,
    ground: JunctionGround,
    around: LineOfSight,
    field: FieldOfView,
    *,
    cost: float = 0.0,
) -> View:
    """Rate a pose of a sensor.

    Args:
        stance: the pose.
        ground: ground to be seen.
        around: obstacles.
        field: field of view of the sensor.
        cost: cost of the position, as a share of the junction.
    """
    sees = visible(stance, ground, around, field)
    beams = field.sample @ rotation_from_ypr(*stance[2:]).T
    hits = around.cast(stance.place[None, :], beams)
    returned = hits.range_m < field.range_m[1]
    lost = returned & (hits.range_m < NEAR_M) & around.is_thing(hits)
    near = float(lost.sum() / max(int(returned.sum()), 1))
    nearest_m = around.nearest_thing(stance.place)[0]
    score = _lit(stance, sees, ground, field) - cost
    score -= _NEAR_COST * near + _CLOSE_COST * max(0.0, 1.0 - nearest_m / CLEAR_M)
    return View(stance, sees, near, nearest_m, score)


def visible(
    stance: Stance, ground: JunctionGround, around: LineOfSight, field: FieldOfView
) -> NDArray[np.bool_]:
    """Return which points (M,) of the ground are in range, in sight and in the field of view."""
    free = around.sees(stance.place, ground.points) & _in_range(stance.place, ground, field)
    return np.asarray(free & _within(stance, ground, field))


def _in_range(
    place: NDArray[np.float64], ground: JunctionGround, field: FieldOfView
) -> NDArray[np.bool_]:
    return np.asarray(np.linalg.norm(ground.points - place, axis=1) <= field.range_m[1])


def _within(stance: Stance, ground: JunctionGround, field: FieldOfView) -> NDArray[np.bool_]:
    """Return which points (M,) of the ground are in the field of view."""
    offset = (ground.points - stance.place) @ rotation_from_ypr(*stance[2:])
    away = np.linalg.norm(offset, axis=1)
    return field.holds(offset / np.maximum(away, 1e-6)[:, None])


def _lit(
    stance: Stance, sees: NDArray[np.bool_], ground: JunctionGround, field: FieldOfView
) -> float:
    """Return the visible share of the ground, weighted down where points would be sparse.

    The density of points on level ground is ``per_steradian`` h / r^3, with h the height above it
    and r the range. Squares with less than one point per square metre count proportionally.
    """
    if not len(ground.points):
        return 0.0
    offset = stance.place - ground.points[sees]
    range_m = np.linalg.norm(offset, axis=1)
    dense = field.per_steradian * (offset[:, 2] + LEVEL_M) / np.maximum(range_m, 1.0) ** 3
    return float(np.clip(dense, 0.0, 1.0).sum() / len(ground.points))


class Junction:
    """The ground around a point of the road network, and the obstacles there.

    Args:
        middle: (2,) site frame.
        network: the lanes.
        region: the region of interest.
        mesh: the static world.
    """

    def __init__(
        self,
        middle: NDArray[np.float64],
        network: RoadNetwork,
        region: shapely.Polygon,
        mesh: LabelledMesh,
    ) -> None:
        self._network, self._region = network, region
        self.ground: JunctionGround = ground_of_network(network, region, middle)
        self.around = LineOfSight(mesh, middle)

    def view_of(self, mounted: MountedSensor) -> View:
        """Return what a sensor sees from its position."""
        field = FieldOfView.coarse(mounted.sensor, mounted.columns)
        return judged(Stance.of(mounted), self.ground, self.around, field)

    @cached_property
    def _places(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return pole_places(self._network, self._region, self.around.mesh, self.ground.middle)

    def best_view(
        self, field: FieldOfView, *, pitch: float, roll: float, tell: Progress = untold
    ) -> View | None:
        """Return the best position on a pole for a sensor; ``None`` if no pole can stand.

        Args:
            field: field of view of the sensor.
            pitch: the sensor's own pitch, radians, tried in addition to the usual ones.
            roll: the sensor's roll, radians.
            tell: called with the fraction done (0..1) and a description.
        """
        places, off_m = self._places
        if not len(places) or not len(self.ground.points):
            return None
        pitches = tuple(dict.fromkeys([pitch, *np.radians(PITCHES_DEG).tolist()]))
        candidates = Candidates(places, off_m, HEIGHTS_M, pitches, roll)
        return best_view(candidates, self.ground, self.around, field, tell)


class Junctions:
    """The junctions of a site's sensors, each prepared once."""

    def __init__(self, network: RoadNetwork, region: shapely.Polygon, mesh: LabelledMesh) -> None:
        self._made_of = (network, region, mesh)
        self._found: dict[tuple[float, float], Junction] = {}

    def at(self, east_m: float, north_m: float) -> Junction:
        """Return the junction of a sensor: the anchor's, or the nearest to a distant sensor."""
        middle = self._middle(np.array([east_m, north_m]))
        key = (round(float(middle[0]), 3), round(float(middle[1]), 3))
        if key not in self._found:
            self._found[key] = Junction(np.array(key), *self._made_of)
        return self._found[key]

    def _middle(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        if np.linalg.norm(place) <= _ANCHOR_M:
            return np.zeros(2)
        outlines = [shape.polygon for shape in self._made_of[0].junctions]
        middles = [
            shapely.get_coordinates(shape.centroid)[0] for shape in outlines if not shape.is_empty
        ]
        away = [float(np.linalg.norm(shape - place)) for shape in middles]
        if not away or min(away) > _NEAREST_M:
            return place
        return np.asarray(middles[int(np.argmin(away))])
