"""Loss terms of a pose: distance of points from surfaces, and of levelled points from channels."""

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
from urbantwin.lidar.pattern import beam_elevations

__all__ = ["COARSE_M", "FINE_M", "PoseTerm", "TiltTerm"]

_TILT_TERM_LOOKS, _FEW = 8000, 1500
#: Distance from a channel at which the loss is a half.
_HALF_RAD = np.radians(0.05)
#: Step of the initial grid search: channels of a dense sensor are a third of a degree apart, and a
#: coarser start ends at another channel.
_STEP_DEG = 0.1


class TiltTerm:
    """Distance of levelled points from the elevation of any channel.

    Levelled points do not rotate with the sensor's pitch and roll, so their positions fit any
    attitude. But only at the right one is every point on a channel.

    Args:
        looks: real points, level with gravity, at the position and heading of the first sensor.
        rig: the rig as written; of spinning sensors.
        seed: seed of the sampled points.
    """

    def __init__(self, looks: Looks, rig: Rig, seed: int) -> None:
        self._rig = rig
        count = len(looks.points)
        rows = np.random.default_rng(seed).permutation(count)[:_TILT_TERM_LOOKS]
        self._points, self._sensor = looks.points[rows], looks.sensor[rows]
        self._sector = sectors_of(self._points)
        self._channels = [np.sort(beam_elevations(one.sensor)) for one in rig.sensors]

    def __call__(self, values: Values) -> Loss:
        """Return the loss for parameter values."""
        losses = self._losses(values, len(self._points))
        return Loss.of(losses, np.ones(len(losses)), self._sector)

    def first_try(self, reach_deg: float) -> dict[str, float]:
        """Return the best of a grid of pitches and rolls."""
        steps = np.arange(-reach_deg, reach_deg + _STEP_DEG / 2, _STEP_DEG)
        tries = [
            {"move.pitch_deg": float(pitch), "move.roll_deg": float(roll)}
            for pitch in steps
            for roll in steps
        ]
        return min(tries, key=lambda one: float(self._losses(one, _FEW).mean()))

    def _losses(self, values: Values, count: int) -> NDArray[np.float64]:
        """Return the loss (N,) of each of the first points."""
        tilt = {k: v for k, v in values.items() if k in ("move.pitch_deg", "move.roll_deg")}
        rig = tuned_rig(self._rig, tilt)
        points, sensor = self._points[:count], self._sensor[:count]
        placed = frame_of_points(rig, "level").apply(points)
        losses = np.empty(len(points))
        for number, one in enumerate(rig.sensors):
            mine = sensor == number
            aim = placed[mine] - one.site_SE3_sensor.translation
            aim /= np.maximum(np.linalg.norm(aim, axis=1), 1e-9)[:, None]
            up = np.arcsin(np.clip(aim @ one.site_SE3_sensor.rotation[:, 2], -1, 1))
            channels = self._channels[number]
            after = np.clip(np.searchsorted(channels, up), 1, len(channels) - 1)
            apart = np.minimum(np.abs(up - channels[after - 1]), np.abs(up - channels[after]))
            losses[mine] = apart**2 / (apart**2 + _HALF_RAD**2)
        return losses


#: Maximum number of points per trial, cell size with one point each (metres), and number of points
#: drawn before thinning.
_LOOKS, _CELL_M, _DRAWN = 8000, 0.25, 200_000
#: Distances at which the loss is a half: for the fine fit, and for the coarse one.
FINE_M: tuple[float, ...] = (0.08, 0.4)
COARSE_M: tuple[float, ...] = (0.4,)
_FAR_M = 80.0


class PoseTerm:
    """Distance of real points from the surfaces of the twin that their beams hit.

    Each point's beam is cast from the sensor at the trial's pose, in its measured direction. The
    difference of the ranges times the cosine of incidence is its distance from the surface,
    infinite without a hit. The loss ``d^2 / (d^2 + h^2)`` (Geman and McClure 1987) limits the
    influence of objects that the twin lacks, and of traffic; a large h gives a wide minimum, a
    small one a sharp minimum.

    Args:
        looks: real points.
        rig: the rig as written.
        mesh: the static world, site frame.
        points_in: frame of the real points.
        seed: seed of the sampled points.
        half_m: values of h; the loss is the mean over them.
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
        """Return the loss for parameter values."""
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
    """Return ``d^2 / (d^2 + h^2)``, 1 for infinite distances."""
    with np.errstate(invalid="ignore"):
        square = (apart / half) ** 2
        return np.where(np.isfinite(square), square / (square + 1), 1.0)


def _spread(looks: Looks, sensor: NDArray[np.float64], seed: int) -> NDArray[np.int64]:
    """Return indices of points near a sensor (3,), spread evenly over the surfaces."""
    rows = np.flatnonzero(np.linalg.norm(looks.points - sensor, axis=1) < _FAR_M)
    order = np.random.default_rng(seed).permutation(rows)[:_DRAWN]
    cells = np.floor(looks.points[order] / _CELL_M).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    return order[np.sort(first)][:_LOOKS]
