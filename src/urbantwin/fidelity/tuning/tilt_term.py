"""The term of the tilt: pitch and roll of a sensor whose points were levelled, from its rings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.tuning.frames import Looks
from urbantwin.fidelity.tuning.knobs import Values
from urbantwin.fidelity.tuning.loss import Loss, sectors_of
from urbantwin.fidelity.tuning.tuned_rig import frame_of_points, tuned_rig
from urbantwin.lidar import Rig
from urbantwin.lidar.pattern import beam_elevations

__all__ = ["TiltTerm"]

_LOOKS, _FEW = 8000, 1500
#: Distance from a channel at which a look counts for half.
_HALF_RAD = np.radians(0.05)
#: Tries of the first search: the channels of a dense sensor are a third of a degree apart, and a
#: search that does not begin within that ends at another channel.
_STEP_DEG = 0.1


class TiltTerm:
    """How far levelled points are from the elevation of any channel.

    Levelled points do not turn with the sensor's pitch and roll, and any attitude explains where
    they lie. But only at the right one does every one of them leave the sensor along a channel.

    Args:
        looks: real points, level with gravity, in the place and heading of the first sensor.
        rig: as it is written; of spinning sensors.
        seed: of which looks are taken.
    """

    def __init__(self, looks: Looks, rig: Rig, seed: int) -> None:
        self._rig = rig
        count = len(looks.points)
        rows = np.random.default_rng(seed).permutation(count)[:_LOOKS]
        self._points, self._sensor = looks.points[rows], looks.sensor[rows]
        self._sector = sectors_of(self._points)
        self._channels = [np.sort(beam_elevations(one.sensor)) for one in rig.sensors]

    def __call__(self, values: Values) -> Loss:
        """Return the loss at some values of the knobs."""
        losses = self._losses(values, len(self._points))
        return Loss.of(losses, np.ones(len(losses)), self._sector)

    def first_try(self, reach_deg: float) -> dict[str, float]:
        """Return the best of evenly spaced pitches and rolls."""
        steps = np.arange(-reach_deg, reach_deg + _STEP_DEG / 2, _STEP_DEG)
        tries = [
            {"move.pitch_deg": float(pitch), "move.roll_deg": float(roll)}
            for pitch in steps
            for roll in steps
        ]
        return min(tries, key=lambda one: float(self._losses(one, _FEW).mean()))

    def _losses(self, values: Values, count: int) -> NDArray[np.float64]:
        """Return a loss (N,) of each of the first looks."""
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
