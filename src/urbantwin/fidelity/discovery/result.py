"""The sensors found: poses and models with standard deviations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity.discovery.elevation_match import TableFit
from urbantwin.fidelity.discovery.point_rays import PointRays, point_rays
from urbantwin.result_warning import ResultWarning, rows_of

__all__ = ["NONE_MISSED", "ONE_TURN", "Discovery", "FoundSensor"]

#: Minimum standard deviations that are reported, of x, y and z, metres, and of tilt, degrees:
#: formal errors neglect swaying poles. A beam origin offset common to all channels is equivalent to
#: another height: heights from four frames of one HDL-64E have a standard deviation of 2 cm.
_LEAST_M, _LEAST_DEG = (0.005, 0.005, 0.02), 0.01
#: Channels with fewer observations are excluded from the comparison with the model.
_FEW_LOOKS = 5.0
#: Minimum share of points on rings if all sensors were found: with one sensor, and with several.
#: Motion-corrected frames of a moving car have 0.62 and more. Simulated rigs with one missed sensor
#: have 0.43, and 0.84 if two thirds of its points are on rings of four others.
_ALL_FOUND, NONE_MISSED = 0.55, 0.9
#: Points per direction on a full ring above which a frame covers several rotations: one rotation
#: has up to 1, hardly more with two returns.
ONE_TURN = 1.5


@dataclass(frozen=True, eq=False)
class FoundSensor:
    """One sensor.

    Attributes:
        name: ``sensor-1`` and so on, by falling number of points.
        models: possible models of the catalogue; empty if none has its channels.
        confidence: probability that it is one of them, if it is in the catalogue at all.
        fit: pose, channels and evidence.
        spread_deg: standard deviation of elevations on its rings.
        step_deg: its azimuth resolution; None with too few points.
        columns: columns per rotation, of its model or as measured.
        points: number of points in the fitted frames.
        dual: firings have two returns.
        looks: points per frame and direction on a full ring, 1 for one rotation.
    """

    name: str
    models: tuple[str, ...]
    confidence: float
    fit: TableFit
    spread_deg: float
    step_deg: float | None
    columns: int
    points: int
    dual: bool
    looks: float = 1.0

    @property
    def place(self) -> NDArray[np.float64]:
        """Position (3,), metres, in the frame of the points."""
        return self.fit.seen_from.place

    @property
    def pitch_roll(self) -> tuple[float, float]:
        """Pitch and roll at a yaw of 0, radians: the yaw cannot be found from points."""
        axis = self.fit.seen_from.axis
        return float(np.arctan2(axis[0], axis[2])), float(-np.arcsin(axis[1]))

    @property
    def sigma_m(self) -> NDArray[np.float64]:
        """Standard deviations (3,) of its position, metres."""
        formal = np.sqrt(np.diag(self.fit.covariance)[:3])
        return np.asarray(np.hypot(formal, np.array(_LEAST_M)))

    @property
    def sigma_tilt_deg(self) -> float:
        """Standard deviation of the direction of its axis, degrees."""
        formal = np.degrees(np.sqrt(np.diag(self.fit.covariance)[3:].max()))
        return float(np.hypot(formal, _LEAST_DEG))

    @property
    def rings(self) -> int:
        """Number of channels with points."""
        return int((self.fit.looks >= 1).sum())

    @property
    def off_model_deg(self) -> float:
        """Root mean square difference of its channels from its model's, degrees."""
        seen = self.fit.looks >= _FEW_LOOKS
        offset = self.fit.unit.offset_deg[seen]
        return float(np.sqrt((offset**2).mean())) if len(offset) else 0.0

    def report(self) -> dict[str, Any]:
        """Return the values for reports."""
        x, y, z = (round(float(one), 3) for one in self.place)
        pitch, roll = (round(float(np.degrees(one)), 3) + 0.0 for one in self.pitch_roll)
        sigma = self.sigma_m
        return {
            "name": self.name,
            "models": list(self.models) or "unknown",
            "confidence": round(self.confidence, 3),
            "east_m": x,
            "north_m": y,
            "up_m": z,
            "pitch_deg": pitch,
            "roll_deg": roll,
            "sigma_plan_m": round(float(sigma[:2].max()), 3),
            "sigma_up_m": round(float(sigma[2]), 3),
            "sigma_tilt_deg": round(self.sigma_tilt_deg, 3),
            "rings": self.rings,
            "channels": len(self.fit.unit.table_deg),
            "off_model_deg": round(self.off_model_deg, 3),
            "ring_spread_deg": round(self.spread_deg, 4),
            "columns": self.columns,
            "azimuth_step_deg": None if self.step_deg is None else round(self.step_deg, 4),
            "points": self.points,
            "returns": "dual" if self.dual else "one",
        }


@dataclass(frozen=True, eq=False)
class Discovery:
    """The sensors of a recording.

    Attributes:
        sensors: the sensors by falling number of points.
        frames: names of the fitted frames.
        points: number of points of the frames in which points were assigned to sensors.
        on_rings: share of those points within 0.05 degrees of a channel of their sensor, with
            neighbours on its ring.
    """

    sensors: tuple[FoundSensor, ...]
    frames: tuple[str, ...]
    points: int
    on_rings: float

    def rays(self, points: NDArray[np.float64]) -> PointRays:
        """Return sensor and ring of (N, 3) points of a frame, in its frame of reference."""
        return point_rays(
            points,
            [one.fit for one in self.sensors],
            [one.step_deg or 360 / one.columns for one in self.sensors],
            [one.spread_deg for one in self.sensors],
        )

    def report(self) -> dict[str, Any]:
        """Return the values for reports."""
        return {
            "sensors": [one.report() for one in self.sensors],
            "yaw": "unknown: points do not show where a sensor's azimuth is zero",
            "frames": len(self.frames),
            "points": self.points,
            "on_rings": round(self.on_rings, 4),
            "warnings": rows_of(self.warnings),
        }

    @property
    def misses(self) -> bool:
        """Whether a sensor may have been missed, whose points are on no ring."""
        return self.on_rings < (NONE_MISSED if len(self.sensors) > 1 else _ALL_FOUND)

    @property
    def turns(self) -> float:
        """Approximate number of rotations per frame."""
        return max((one.looks for one in self.sensors), default=1.0)

    @property
    def crowded(self) -> bool:
        """Whether frames cover several rotations."""
        return self.turns > ONE_TURN

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings: a missed sensor, frames of several rotations."""
        found = []
        if self.misses:
            found.append(
                ResultWarning(
                    "rings",
                    f"{self.on_rings:.0%} of the points are on rings of the sensors found",
                    "a sensor was missed, or its model and channels are wrong",
                    "give more frames, uncropped, or those of one sensor alone",
                )
            )
        if self.crowded:
            found.append(
                ResultWarning(
                    "frames",
                    f"each direction of a ring has {self.turns:.1f} points in a frame",
                    "several turns were put together, and sensors may be missed or found twice",
                    "give each turn as a frame",
                )
            )
        return tuple(found)
