"""Loss terms of actors: their number and sizes, from moving points alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from urbantwin.fidelity.background_subtraction import LEAST_FRAMES, Background
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.tuning.knobs import Knob, Values
from urbantwin.fidelity.tuning.loss import SECTORS, Loss
from urbantwin.geometry import DownwardProbe, LabelledMesh, Pose
from urbantwin.taxonomy import ACTOR_CLASSES

__all__ = ["KINDS", "ActorTerms", "Clusters", "actor_changes", "actor_knobs", "clusters_of"]

#: Kinds of clusters, and their actor classes.
KINDS = {
    "vehicles": ("car", "truck", "bus", "van"),
    "small": ("motorcycle", "bicycle", "pedestrian"),
}
#: Maximum distance at which actors have enough points to cluster, metres.
_REACH_M = 40.0
#: Maximum distance in plan of neighbouring points of a cluster, metres.
_JOINED_M = 0.5
_LEAST_POINTS = 15
#: Minimum long side of a vehicle's cluster, metres.
_VEHICLE_M = 2.2
#: Minimum and maximum height of actors, metres.
_LOWEST_M, _HIGHEST_M = 0.6, 4.5
#: Minimum number of clusters on both sides to fit a kind.
_LEAST_CLUSTERS = 30
_AXES = ("length", "width", "height")
#: Fitted dimensions by class, and the clusters that show them: bounds of long side, short side and
#: height, metres.
_SIZED = {
    "car": (("length", "width", "height"), ((3.0, 6.5), (1.2, 2.4), (1.0, 2.3))),
    "pedestrian": (("height",), ((0.2, 1.1), (0.0, 1.1), (1.3, 2.2))),
}


@dataclass(frozen=True, eq=False)
class Clusters:
    """Clusters of moving points in some frames, without classes.

    Attributes:
        size: (N, 3) long side, short side in plan, height above the ground, metres.
        time: (N,) which of `SECTORS` equal intervals of time: an actor is present in many frames,
            so its clusters in one interval are not independent.
        vehicle: (N,) whether the size is that of a vehicle.
        frames: number of frames.
    """

    size: NDArray[np.float64]
    time: NDArray[np.int64]
    vehicle: NDArray[np.bool_]
    frames: int

    def of(self, kind: str) -> NDArray[np.bool_]:
        """Return the mask of the clusters of a kind."""
        return self.vehicle if kind == "vehicles" else ~self.vehicle


def clusters_of(
    clouds: Sequence[Frame],
    site_SE3_points: Pose,
    places: NDArray[np.float64],
    ground: LabelledMesh,
) -> Clusters | None:
    """Return the clusters of moving points; ``None`` with too few frames.

    Args:
        clouds: frames in order of time.
        site_SE3_points: pose of their points.
        places: (S, 3) positions of the sensors in their frame.
        ground: ground under the actors, site frame.
    """
    if len(clouds) < LEAST_FRAMES:
        return None
    # Rings and columns are dropped, so that both sides have the same attributes.
    plain = [replace(one, ring=None, column=None, sensor_places=places) for one in clouds]
    still = Background(plain)
    probe = DownwardProbe(ground)
    sizes: list[NDArray[np.float64]] = []
    times: list[int] = []
    for number, cloud in enumerate(plain):
        near = np.linalg.norm(cloud.points - places[0], axis=1) < _REACH_M
        moving = site_SE3_points.apply(cloud.points[still.foreground(cloud) & near])
        for points in _clusters(moving):
            foot = float(probe.height_below(points.mean(axis=0)[None] + [0, 0, 1.0])[0])
            tall = float(points[:, 2].max()) - foot
            if not _LOWEST_M < tall < _HIGHEST_M:
                continue
            sizes.append(np.array([*_sides(points[:, :2]), tall]))
            times.append(number * SECTORS // len(plain))
    size = np.array(sizes).reshape(-1, 3)
    return Clusters(size, np.array(times, np.int64), size[:, 0] >= _VEHICLE_M, len(clouds))


def _clusters(points: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the clusters of points (N, 3) that are near each other in plan."""
    if len(points) < _LEAST_POINTS:
        return []
    cells, owner = np.unique(
        np.floor(points[:, :2] / (_JOINED_M / 2)).astype(np.int64), axis=0, return_inverse=True
    )
    pairs = cKDTree(cells.astype(float)).query_pairs(2.3, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(cells), len(cells)))
    _, label = connected_components(graph, directed=False)
    of_point = label[owner.ravel()]
    order = np.argsort(of_point, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(of_point[order])) + 1)
    return [points[part] for part in parts if len(part) >= _LEAST_POINTS]


def _sides(plan: NDArray[np.float64]) -> tuple[float, float]:
    """Return the long and the short side of the smallest rectangle around points (N, 2)."""
    around = shapely.minimum_rotated_rectangle(shapely.MultiPoint(plan))
    if around.geom_type != "Polygon":
        return float(around.length), 0.0
    corners = np.array(around.exterior.coords)
    sides = np.linalg.norm(np.diff(corners[:3], axis=0), axis=1)
    return float(sides.max()), float(sides.min())


class ActorTerms:
    """Loss term of actors: number of clusters of each kind per frame, and their sizes.

    - Numbers: the Poisson deviance of the real clusters per interval of time; the expected number
      is the simulated mean times the density.
    - Sizes: the distance of every real cluster's log dimension to all simulated ones' plus the log
      of the factor; the minimum of the sum is the estimator of Hodges and Lehmann 1963. Occlusion
      affects both sides alike, so hidden parts do not matter.

    Args:
        real: clusters of the real frames.
        simulated: clusters of the twin's frames, found by the same rule.
    """

    def __init__(self, real: Clusters, simulated: Clusters) -> None:
        self._real, self._simulated = real, simulated
        #: Classes with enough clusters to fit a size, and the fitted dimensions.
        self.sides = {
            kind: sides
            for kind, (sides, _) in _SIZED.items()
            if min(_sized(real, kind).sum(), _sized(simulated, kind).sum()) >= _LEAST_CLUSTERS
        }
        #: Kinds with enough clusters to fit a density.
        self.kinds = tuple(
            kind
            for kind in KINDS
            if min(real.of(kind).sum(), simulated.of(kind).sum()) >= _LEAST_CLUSTERS
        )

    def __call__(self, values: Values) -> Loss:
        """Return the loss for parameter values."""
        losses: list[NDArray[np.float64]] = []
        sectors: list[NDArray[np.int64]] = []
        real, simulated = self._real, self._simulated
        for kind in self.kinds:
            count = np.bincount(real.time[real.of(kind)], minlength=SECTORS).astype(np.float64)
            spans = np.bincount(np.arange(real.frames) * SECTORS // real.frames, minlength=SECTORS)
            expected = spans * (simulated.of(kind).sum() / simulated.frames) + 1e-9
            expected = expected * values.get(f"density.{kind}", 1.0)
            deviance = count * np.log(np.maximum(count, 1e-9) / expected) - (count - expected)
            losses.append(2 * deviance / count.sum())
            sectors.append(np.arange(SECTORS))
        for kind, sides in self.sides.items():
            ours, theirs = _sized(real, kind), _sized(simulated, kind)
            for name in sides:
                axis = _AXES.index(name)
                shift = np.log(values.get(f"size.{kind}.{name}", 1.0))
                apart = np.log(real.size[ours, axis])[:, None] - shift
                apart = apart - np.log(simulated.size[theirs, axis])
                losses.append(np.abs(apart).mean(axis=1) / int(ours.sum()))
                sectors.append(real.time[ours])
        if not losses:
            return Loss(np.zeros(SECTORS), np.zeros(SECTORS))
        loss = np.concatenate(losses)
        return Loss.of(loss * len(loss), np.ones(len(loss)) / len(loss), np.concatenate(sectors))


def _sized(clusters: Clusters, kind: str) -> NDArray[np.bool_]:
    """Return the mask of clusters (N,) that are most likely of a class and show its size."""
    low, high = np.array(_SIZED[kind][1]).T
    return np.asarray(((clusters.size >= low) & (clusters.size <= high)).all(axis=1))


def actor_knobs(terms: ActorTerms) -> list[Knob]:
    """Return the actor parameters that can be fitted."""
    knobs = [Knob(f"density.{kind}", "actors", 1.0, 0.2, 5.0, times=True) for kind in terms.kinds]
    for kind, sides in terms.sides.items():
        knobs += [
            Knob(f"size.{kind}.{name}", "actors", 1.0, 0.7, 1.4, times=True) for name in sides
        ]
    return knobs


def actor_changes(values: Values, per_hour: dict[str, float]) -> dict[str, dict[str, Any]]:
    """Return the fields of ``traffic:`` that parameter values change: demand and sizes."""
    demand = dict(per_hour)
    size: dict[str, dict[str, float]] = {}
    for kind, classes in KINDS.items():
        for name in classes:
            demand[name] = round(demand.get(name, 0.0) * values.get(f"density.{kind}", 1.0), 3)
    for kind in _SIZED:
        head = f"size.{kind}."
        own = {k.removeprefix(head): round(v, 5) for k, v in values.items() if k.startswith(head)}
        own = {k: v for k, v in own.items() if v != 1.0}
        if own:
            size[kind] = own
    changed: dict[str, dict[str, Any]] = {
        "per_hour": {name: demand.get(name, 0.0) for name in ACTOR_CLASSES}
    }
    return {**changed, "size": size} if size else changed
