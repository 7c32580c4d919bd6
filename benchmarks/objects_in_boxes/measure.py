"""Real objects and our bodies in their boxes, compared object by object and ray by ray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, median_filter
from scipy.spatial import cKDTree

from objects_in_boxes.bodies import AROUND_M, GROUND_M, PlacedBody, candidates
from objects_in_boxes.frame_rays import FrameRays, rays_of
from objects_in_boxes.mending import PassedBy, mended_of
from objects_in_boxes.movement import bodies_then, owners_then, shifts_of
from objects_in_boxes.scan_rays import SeenBodies, scan_rays
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh
from urbantwin.lidar.sensor import Sensor
from urbantwin.taxonomy import ACTOR_CLASSES, material_id, semantic_id

__all__ = ["ObjectSeen", "RaysSeen", "compare_objects"]

#: Objects with fewer real points are left out; shapes are compared from so many points on.
FEWEST = 10
#: A real point before our surface by more than this was of something before the object, metres.
BEFORE_M = 0.4
#: A point behind a pane by more than this was seen through it.
THROUGH_M = 0.3
#: Objects farther away are left out, metres.
_FARTHEST_M = 80.0
#: Between the seeds of two draws of the same frame.
_AGAIN = 1_000_003
#: Between the numbers of objects in two draws of coats.
_COATS = 10_007
#: Cells of the ground, metres.
_CELL_M = 1.0


@dataclass(frozen=True, eq=False)
class RaysSeen:
    """What came back along the rays that meet a body or that found a point of its object.

    Attributes:
        pane: (R,) whether the ray meets a pane of ours first.
        judged: (R,) whether its neighbours on both sides that returned are of the object, and it
            does not leave ours again through panes alone.
        real_lost: (R,) whether the real ray came back with nothing.
        lost: (R,) whether ours did.
        real_far: (R,) whether the real point was seen through a pane.
        far: (R,) whether ours was.
    """

    pane: NDArray[np.bool_]
    judged: NDArray[np.bool_]
    real_lost: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    real_far: NDArray[np.bool_]
    far: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ObjectSeen:
    """One labelled object and our body in its place.

    Attributes:
        frame: its frame's name.
        class_name: one of ``taxonomy.ACTOR_CLASSES``.
        source_name: the class as the data calls it.
        asset: our body.
        distance_m: from the sensor.
        box: (7,) as annotated.
        mended_box: (7,) moved and stretched to the points.
        real: (N, 3) the object's points.
        ours: (M, 3) our body's, in the mended box, along rays that nothing stood before.
        counts: points by side: ``real``, ``mended``, ``annotated``.
        chamfer_m: symmetric Chamfer distance to the real points by box: ``mended``, ``annotated``;
            and in the mended box ``both``: of rays that returned from the real object and from
            ours, the error of shape without that of drop-out; ``opaque``: of those that meet no
            pane of ours first; ``again``: of all that returned from both, ours to ours in another
            draw of noise and of what panes let through: the floor of ``both``.
        real_codes: (N,) intensity of the real points, 0 to 1; (0,): the data has none.
        codes: (M,) of ours.
        rays: ray by ray, in the mended box.
    """

    frame: str
    class_name: str
    source_name: str
    asset: str
    distance_m: float
    box: NDArray[np.float64]
    mended_box: NDArray[np.float64]
    real: NDArray[np.float64]
    ours: NDArray[np.float64]
    counts: Mapping[str, int]
    chamfer_m: Mapping[str, float | None]
    real_codes: NDArray[np.float64]
    codes: NDArray[np.float64]
    rays: RaysSeen = field(repr=False)

    def as_json(self) -> dict[str, Any]:
        """Return its figures."""
        return {
            "frame": self.frame,
            "class": self.class_name,
            "called": self.source_name,
            "asset": self.asset,
            "distance_m": round(self.distance_m, 2),
            "box": [round(float(one), 3) for one in self.box],
            "mended_box": [round(float(one), 3) for one in self.mended_box],
            "points": dict(self.counts),
            "chamfer_m": {
                name: None if one is None else round(one, 4) for name, one in self.chamfer_m.items()
            },
        }


def compare_objects(
    frame: Frame, sensor: Sensor, *, scale: float | None, seed: int = 0, coats: int = 0
) -> list[ObjectSeen]:
    """Put our bodies into the boxes of a frame and see them along its own rays.

    Args:
        frame: with labels, and with rings or in the order of rings.
        sensor: that recorded it: what it makes of echoes. Where rays point the frame says itself.
        scale: full scale of real intensity; ``None``: none is compared.
        seed: of random numbers.
        coats: number of another draw of coats; shapes and boxes are the same with each.

    Raises:
        InputError: the frame's rays cannot be told.
    """
    boxes = frame.boxes
    if boxes is None or not len(boxes):
        return []
    sensors = rays_of(frame)
    which = np.zeros(len(frame.points), np.int64)
    if frame.sensor is not None:
        which = np.unique(frame.sensor, return_inverse=True)[1].ravel()
    shift = shifts_of(frame, which, AROUND_M)
    owner = owners_then(boxes, frame.points, which, shift, AROUND_M)
    under = boxes.box[:, 2] - boxes.box[:, 5] / 2
    held = owner >= 0
    held[held] = frame.points[held, 2] > under[owner[held]] + GROUND_M
    owner = np.where(held, owner, -1)
    count = np.bincount(owner[held], minlength=len(boxes))
    away = np.linalg.norm(boxes.box[:, :3] - frame.sensor_places[0], axis=1)
    known = np.array([name in ACTOR_CLASSES for name in boxes.class_names])
    chosen = np.flatnonzero(known & (count >= FEWEST) & (away < _FARTHEST_M))
    if not len(chosen):
        return []
    sources = boxes.source_names or boxes.class_names
    number = np.full(len(boxes), -1)
    number[chosen] = np.arange(len(chosen))
    of_points = np.where(owner >= 0, number[owner], -1)
    # Each where it was for all sensors together.
    points_then = frame.points - np.where(owner[:, None] >= 0, shift[which, owner], 0.0)
    shift = shift[:, chosen]
    tried = [
        candidates(boxes.class_names[n], boxes.box[n], int(k) + _COATS * coats, sources[n])
        for k, n in enumerate(chosen)
    ]
    annotated = [bodies[0] for bodies in tried]
    better = [
        mended_of(
            bodies, points_then[of_points == k], _passed_by(bodies[0].box, sensors, shift[:, k])
        )
        for k, bodies in enumerate(tried)
    ]
    ground = _ground_of(frame, owner, boxes.box)
    looks = [
        _Look.of(rays, of_points, moved, annotated, better)
        for rays, moved in zip(sensors, shift, strict=True)
    ]
    seen = {
        side: [look.scan(sensor, bodies, ground, seed) for look in looks]
        for side, bodies in (("annotated", annotated), ("mended", better))
    }
    again = [look.scan(sensor, better, ground, seed + _AGAIN) for look in looks]
    found = []
    for k, n in enumerate(chosen):
        real = np.flatnonzero(of_points == k)
        points = {
            side: np.concatenate(
                [look.points(one, k, better) for look, one in zip(looks, sides, strict=True)]
            )
            for side, sides in seen.items()
        }
        ours = points["mended"]
        codes = np.zeros(0)
        if frame.intensity is not None and scale:
            codes = np.clip(frame.intensity[real] / scale, 0, 1)
        rays = [look.outcome(one, k) for look, one in zip(looks, seen["mended"], strict=True)]
        found.append(
            ObjectSeen(
                frame.name,
                boxes.class_names[n],
                sources[n],
                better[k].asset,
                float(away[n]),
                boxes.box[n],
                better[k].box,
                points_then[real],
                ours[:, :3],
                {"real": len(real)} | {side: len(one) for side, one in points.items()},
                {side: _chamfer(points_then[real], one[:, :3]) for side, one in points.items()}
                | _of_both(points_then, looks, seen["mended"], k, better)
                | {"again": _drawn_again(looks, seen["mended"], again, k, better)},
                codes,
                ours[:, 3],
                RaysSeen(*(np.concatenate(parts) for parts in zip(*rays, strict=True))),
            )
        )
    return found


def _passed_by(
    box: NDArray[np.float64], sensors: list[FrameRays], shift: NDArray[np.float64]
) -> PassedBy:
    found = PassedBy.none()
    for rays, moved in zip(sensors, shift, strict=True):
        # As if the sensor had moved by as much the other way, and the object stood.
        place = rays.origin - moved
        found = found.joined(PassedBy.of(box, place, rays.direction, rays.range_m))
    return found


@dataclass(frozen=True, eq=False)
class _Look:
    """The rays of one sensor that come near objects.

    Attributes:
        rays: all of the sensor's.
        near: (R,) numbers of those that come near an object.
        owner: (R,) the object that each real one found, -1 for none.
        between: (R,) the object that its neighbours on both sides found, -1 for none.
        shift: (B, 3) where objects were then, less where they are for all sensors together.
    """

    rays: FrameRays
    near: NDArray[np.int64]
    owner: NDArray[np.int64]
    between: NDArray[np.int64]
    shift: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        rays: FrameRays,
        of_points: NDArray[np.int64],
        shift: NDArray[np.float64],
        *sides: list[PlacedBody],
    ) -> _Look:
        close = np.zeros(len(rays.direction), np.bool_)
        for body in (body for bodies in sides for body in bodies_then(bodies, shift)):
            middle = body.box[:3] - rays.origin
            distance = max(float(np.linalg.norm(middle)), 1e-6)
            reach = float(np.linalg.norm(body.box[3:6])) / 2 + AROUND_M
            wide = float(np.arctan2(reach, max(distance**2 - reach**2, 0.0) ** 0.5))
            close |= rays.direction @ (middle / distance) > np.cos(wide)
        found = np.where(rays.point >= 0, of_points[rays.point], -1)
        near = np.flatnonzero(close | (found >= 0))
        before, after = found[rays.before[near]], found[rays.after[near]]
        return cls(rays, near, found[near], np.where(before == after, before, -1), shift)

    def scan(
        self, sensor: Sensor, bodies: list[PlacedBody], ground: LabelledMesh, seed: int
    ) -> SeenBodies:
        """Return what the sensor sees of bodies where they were then."""
        there = bodies_then(bodies, self.shift)
        # What ended at no object ended before it, and then counts on neither side, or behind.
        behind = np.where(self.owner < 0, self.rays.range_m[self.near], np.inf)
        return scan_rays(sensor, self.rays.origin, self.direction, there, ground, behind, seed)

    @property
    def direction(self) -> NDArray[np.float64]:
        return np.asarray(self.rays.direction[self.near])

    def _is_blocked(self, seen: SeenBodies) -> NDArray[np.bool_]:
        before = self.rays.range_m[self.near] < seen.meets_m - BEFORE_M
        return np.asarray((self.owner < 0) & before)

    def points(self, seen: SeenBodies, body: int, bodies: list[PlacedBody]) -> NDArray[np.float64]:
        """Return our points of a body (M, 4) with their intensity, where nothing stands before."""
        mine = (seen.reported == body) & ~self._is_blocked(seen)
        points = self._places(seen, mine, body)
        box = bodies[body].box
        above = points[:, 2] > box[2] - box[5] / 2 + GROUND_M
        return np.asarray(np.column_stack([points, seen.intensity[mine]])[above])

    def of_both(
        self, points: NDArray[np.float64], seen: SeenBodies, body: int, bodies: list[PlacedBody]
    ) -> NDArray[np.float64]:
        """Return real points and ours along rays that returned from a body on both sides.

        (M, 7): the real one, ours, and whether the ray meets a pane of ours first.
        """
        mine, ours = self._shared(seen, body, bodies)
        real = points[self.rays.point[self.near[mine]]]
        return np.asarray(np.column_stack([real, ours, seen.is_pane[mine]]))

    def of_draws(
        self, seen: SeenBodies, again: SeenBodies, body: int, bodies: list[PlacedBody]
    ) -> NDArray[np.float64]:
        """Return our points in two draws (M, 6), of those rays."""
        mine, ours = self._shared(seen, body, bodies)
        both = again.reported[mine] == body
        mine, ours = mine[both], ours[both]
        return np.asarray(np.column_stack([ours, self._places(again, mine, body)]))

    def _places(
        self, seen: SeenBodies, mine: NDArray[np.generic], body: int
    ) -> NDArray[np.float64]:
        """Return what came back along rays from a body (M, 3), as if all saw it at one time."""
        away = self.direction[mine] * seen.range_m[mine, None]
        return np.asarray(self.rays.origin + away - self.shift[body])

    def _shared(
        self, seen: SeenBodies, body: int, bodies: list[PlacedBody]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return which rays (M,) returned from a body on both sides, and our points (M, 3)."""
        mine = np.flatnonzero((seen.reported == body) & (self.owner == body))
        ours = self._places(seen, mine, body)
        box = bodies[body].box
        above = ours[:, 2] > box[2] - box[5] / 2 + GROUND_M
        return mine[above], ours[above]

    def outcome(self, seen: SeenBodies, body: int) -> tuple[NDArray[np.bool_], ...]:
        """Return what `RaysSeen` holds of a body."""
        meets = (seen.body == body) & ~self._is_blocked(seen)
        mine = np.flatnonzero(meets)
        range_m = self.rays.range_m[self.near][mine]
        own, returned = self.owner[mine] == body, np.isfinite(range_m)
        surface = seen.meets_m[mine] + THROUGH_M
        lost = ~np.isfinite(seen.range_m[mine])
        return (
            seen.is_pane[mine],
            (self.between[mine] == body) & ~seen.is_open[mine],
            ~returned,
            lost,
            own & seen.is_pane[mine] & (range_m > surface),
            (seen.reported[mine] == body) & seen.is_pane[mine] & (seen.range_m[mine] > surface),
        )


def _of_both(
    points: NDArray[np.float64],
    looks: list[_Look],
    seen: list[SeenBodies],
    body: int,
    bodies: list[PlacedBody],
) -> dict[str, float | None]:
    """Return Chamfer distances of the rays that returned from a body on both sides, metres."""
    found = [look.of_both(points, one, body, bodies) for look, one in zip(looks, seen, strict=True)]
    both = np.concatenate(found)
    opaque = both[both[:, 6] == 0]
    return {
        "both": _chamfer(both[:, :3], both[:, 3:6]),
        "opaque": _chamfer(opaque[:, :3], opaque[:, 3:6]),
    }


def _drawn_again(
    looks: list[_Look],
    seen: list[SeenBodies],
    again: list[SeenBodies],
    body: int,
    bodies: list[PlacedBody],
) -> float | None:
    """Return the Chamfer distance of a body to itself in another draw, metres."""
    found = [
        look.of_draws(one, other, body, bodies)
        for look, one, other in zip(looks, seen, again, strict=True)
    ]
    both = np.concatenate(found)
    return _chamfer(both[:, :3], both[:, 3:])


def _chamfer(real: NDArray[np.float64], ours: NDArray[np.float64]) -> float | None:
    if min(len(real), len(ours)) < FEWEST:
        return None
    there, back = cKDTree(ours).query(real)[0], cKDTree(real).query(ours)[0]
    return float((there.mean() + back.mean()) / 2)


def _ground_of(frame: Frame, owner: NDArray[np.int64], box: NDArray[np.float64]) -> LabelledMesh:
    """Return the ground between the objects as asphalt: the lowest points of cells, smoothed."""
    middle = frame.sensor_places[0, :2]
    half = _FARTHEST_M + 20.0
    count = int(2 * half / _CELL_M)
    low = np.full((count, count), np.inf)
    cell = np.floor((frame.points[:, :2] - middle + half) / _CELL_M).astype(np.int64)
    inside = (owner < 0) & (cell >= 0).all(axis=1) & (cell < count).all(axis=1)
    np.minimum.at(low, (cell[inside, 0], cell[inside, 1]), frame.points[inside, 2])
    # Objects stand on the ground; points far above that are of walls and trees.
    under = box[:, 2] - box[:, 5] / 2
    at = np.column_stack([box[:, :2] - middle, np.zeros(len(box))])[:, :2]
    rows = np.arange(count) * _CELL_M - half + _CELL_M / 2
    x, y = np.meshgrid(rows, rows, indexing="ij")
    near = cKDTree(at).query(np.column_stack([x.ravel(), y.ravel()]))[1].reshape(x.shape)
    low[np.abs(low - under[near]) > 1.0] = np.inf
    known = np.isfinite(low)
    if known.any():
        nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
        low = median_filter(low[tuple(nearest)], 5)
    else:
        low = under[near]
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + count, corner + count + 1]),
            np.column_stack([corner, corner + count + 1, corner + 1]),
        ]
    )
    vertices = np.column_stack([(x + middle[0]).ravel(), (y + middle[1]).ravel(), low.ravel()])
    return LabelledMesh.build(vertices, faces, semantic_id("road"), material_id("asphalt"))
