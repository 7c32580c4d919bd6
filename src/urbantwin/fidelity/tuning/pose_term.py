"""The term of the pose: distances of real points from the twin's surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.knobs import Values
from urbantwin.fidelity.tuning.loss import Loss, sectors_of
from urbantwin.fidelity.tuning.tuned_rig import PointsIn, frame_of_points, tuned_rig
from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar import Rig

__all__ = ["COARSE_M", "FINE_M", "PoseTerm"]

#: Looks that are cast in every trial, one from every cell, metres.
_LOOKS, _CELL_M, _DRAWN = 8000, 0.25, 200_000
#: Distances at which a look counts for half: to begin with, and to end with.
FINE_M: tuple[float, ...] = (0.08, 0.4)
COARSE_M: tuple[float, ...] = (0.4,)
_FAR_M = 80.0


class PoseTerm:
    """How far real points lie from the surface of the twin that their beams meet.

    Each look is cast from the sensor at the trial's pose, in its own measured direction; the
    difference of the ranges times the cosine of incidence is its distance from the surface there.
    Of one that meets nothing it is unlimited. The loss ``d^2 / (d^2 + h^2)`` (Geman and McClure
    1987) lets what the twin lacks, and traffic, have little say; a large h has a wide valley, a
    small one a sharp bottom.

    Args:
        looks: real points.
        rig: as it is written.
        mesh: the static world, site frame.
        points_in: the frame of the real points.
        seed: of which looks are taken.
        half_m: every h; the loss is the mean over them.
    """

    def __init__(
        self,
        looks: Looks,
        rig: Rig,
        mesh: LabelledMesh,
        points_in: PointsIn,
        seed: int,
        half_m: tuple[float, ...] = FINE_M,
    ) -> None:
        self._half_m = half_m
        self._rig, self._points_in = rig, points_in
        self._near = rig.sensors[0].site_SE3_sensor.translation
        self._caster = RayScene(mesh.vertices - self._near, mesh.faces)
        self._normals = mesh.normals()
        origin = frame_of_points(rig, points_in).inverse().apply(self._near[None])
        rows = _spread(looks, origin, seed)
        self._points, self._sensor = looks.points[rows], looks.sensor[rows]
        self._sector = sectors_of(self._points)
        self._weight = np.ones(len(rows))

    def __call__(self, values: Values) -> Loss:
        """Return the loss at some values of the knobs."""
        rig = tuned_rig(self._rig, values)
        pose = frame_of_points(rig, self._points_in)
        places = np.array([one.site_SE3_sensor.translation for one in rig.sensors])
        offsets = np.array([one.calibration.range_offset_m for one in rig.sensors])
        origin = places[self._sensor]
        aim = pose.apply(self._points) - origin
        away = np.linalg.norm(aim, axis=1)
        aim /= np.maximum(away, 1e-9)[:, None]
        hits = self._caster.cast(origin - self._near, aim.astype(np.float32))
        hit = hits.face >= 0
        apart = np.full(len(away), np.inf)
        cosine = np.abs((self._normals[hits.face[hit]] * aim[hit]).sum(axis=1))
        apart[hit] = (away - offsets[self._sensor])[hit] - hits.range_m[hit]
        apart[hit] *= cosine
        losses = np.mean([_bounded(apart, half) for half in self._half_m], axis=0)
        return Loss.of(losses, self._weight, self._sector)


def _bounded(apart: NDArray[np.float64], half: float) -> NDArray[np.float64]:
    """Return ``d^2 / (d^2 + h^2)``, 1 for what is infinitely far."""
    with np.errstate(invalid="ignore"):
        square = (apart / half) ** 2
        return np.where(np.isfinite(square), square / (square + 1), 1.0)


def _spread(looks: Looks, sensor: NDArray[np.float64], seed: int) -> NDArray[np.int64]:
    """Return rows of looks near a sensor (3,), spread evenly over the surfaces."""
    rows = np.flatnonzero(np.linalg.norm(looks.points - sensor, axis=1) < _FAR_M)
    order = np.random.default_rng(seed).permutation(rows)[:_DRAWN]
    cells = np.floor(looks.points[order] / _CELL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return order[np.sort(first)][:_LOOKS]
