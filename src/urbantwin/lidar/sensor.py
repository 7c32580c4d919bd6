"""Datasheet of a LiDAR: beam directions, firing times, range, noise and intensity.

Signs. Elevation is positive up. An azimuth offset is **counter-clockwise positive** seen from
above, in the sensor frame (x forward, y left, z up), whatever the maker's own convention:

- Velodyne calibration files: the driver (ros-drivers/velodyne ``rawdata.cc``) computes the
  direction at clockwise angle ``encoder - rot_correction``, so our offset is ``+rot_correction``.
- Hesai correction files: the driver (HesaiLidar_General_ROS ``pandarGeneral_internal.cc``) adds the
  file's azimuth to a clockwise encoder angle, so our offset is ``-Azimuth``.
- Ouster metadata: the sensor's manual ("Lidar Range to XYZ") turns counter-clockwise by
  ``-beam_azimuth_angles``, so our offset is ``-beam_azimuth_angles``.

``None`` means that the value is unknown: ``Sensor.unknown`` says why. Code that needs one anyway
uses the documented defaults ``Sensor.assumed_*``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from urbantwin.lidar.scan_pattern import ScanPattern

__all__ = ["Sensor"]

_ASSUMED_RANGE_SIGMA_M = 0.007
_ASSUMED_RANGE_RESOLUTION_M = 0.001
_ASSUMED_RANGE_MIN_M = 0.5
_ASSUMED_RANGE_MAX_M = 100.0
_ASSUMED_WAVELENGTH_NM = 905.0
_ASSUMED_DIVERGENCE_DEG = (0.18, 0.09)
_ASSUMED_REFLECTIVITY = 0.1


@dataclass(frozen=True, eq=False)
class Sensor:
    """A LiDAR model: beam directions and range performance.

    Attributes:
        name: name of the model.
        maker: manufacturer.
        elevation_deg: (C,) float64, elevation of each channel, degrees, positive up, in the maker's
            numbering of channels.
        azimuth_offset_deg: (C,) float64, direction of each channel relative to the encoder,
            degrees, counter-clockwise positive.
        columns: default firings per turn.
        columns_options: all offered numbers of firings per turn.
        rate_hz: default turns per second.
        rate_options: all offered rates.
        range_min_m: minimum range.
        range_max_m: maximum reported range.
        reference_reflectivity: diffuse reflectivity (0..1) of the target of ``reference_range_m``.
        reference_range_m: range at which that target is detected.
        range_sigma_m: standard deviation of a range measurement.
        range_resolution_m: resolution of the reported range.
        wavelength_nm: wavelength of the laser.
        spin: ``cw`` or ``ccw`` seen from above.
        sources: document of each field's value.
        aliases: other names of the model.
        modes: pairs of columns and turns per second that are offered together.
        firing_time_us: (C,) float64, firing time of each channel, microseconds after the maker's
            reference instant of the column; equal times fire together.
        firing_sequence_us: time between two firings of a channel, if fixed and independent of the
            mode.
        azimuth_step_deg: resolution of the reported azimuth.
        beam_divergence_deg: full width at half maximum, horizontal and vertical, degrees; a
            datasheet's figure without a level is taken as that.
        return_modes: return modes of the sensor.
        intensity_scale: meaning of the reported intensity.
        intensity_of_white: intensity reported for a diffuse reflectivity of 100 %.
        intensity_max: greatest reported intensity.
        detection_range_10_m: range at which a diffuse target of 10 % is detected.
        detection_range_80_m: range at which a diffuse target of 80 % is detected.
        beam_origin_m: distance of the beams' origin from the axis, metres.
        measured_light: signal strength of real units relative to the datasheet's ranges.
        measured_sigma_m: standard deviation of the ranges of strong echoes, of real units.
        measured_faintest: reflectivity (of white) at which half is missed at close range, of real
            units.
        measured_divergence_deg: as ``beam_divergence_deg``, of real units.
        weak_sigma_m: standard deviation of the range of the datasheet's 10 % target at its range.
        overlap_m: distance at which the receiver collects half of a near target's light.
        measured_code_scale: ratio of reported to nominal intensity codes, of real units.
        pattern: non-repeating scan pattern; its lines are the channels, at their mean elevation,
            and the columns are the points of a line in a frame.
        points_per_second: point rate of all lines of such a sensor.
        unknown: reason why a field's value is unknown.
    """

    name: str
    maker: str
    elevation_deg: NDArray[np.float64]
    azimuth_offset_deg: NDArray[np.float64]
    columns: int
    columns_options: tuple[int, ...]
    rate_hz: float
    rate_options: tuple[float, ...]
    range_min_m: float | None
    range_max_m: float | None
    reference_reflectivity: float | None
    reference_range_m: float | None
    range_sigma_m: float | None
    range_resolution_m: float | None
    wavelength_nm: float | None
    spin: Literal["cw", "ccw"]
    sources: dict[str, str]
    aliases: tuple[str, ...] = ()
    modes: tuple[tuple[int, float], ...] | None = None
    firing_time_us: NDArray[np.float64] | None = None
    firing_sequence_us: float | None = None
    azimuth_step_deg: float | None = None
    beam_divergence_deg: tuple[float, float] | None = None
    return_modes: tuple[str, ...] | None = None
    intensity_scale: str | None = None
    intensity_of_white: float | None = None
    intensity_max: float | None = None
    detection_range_10_m: float | None = None
    detection_range_80_m: float | None = None
    beam_origin_m: float | None = None
    measured_light: float | None = None
    measured_sigma_m: float | None = None
    measured_faintest: float | None = None
    measured_divergence_deg: tuple[float, float] | None = None
    weak_sigma_m: float | None = None
    overlap_m: float | None = None
    measured_code_scale: float | None = None
    pattern: ScanPattern | None = None
    points_per_second: float | None = None
    unknown: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of_beams(
        cls,
        maker: str,
        elevation_deg: NDArray[np.float64],
        azimuth_offset_deg: NDArray[np.float64],
        columns: int,
        rate_hz: float,
    ) -> Sensor:
        """Return a nameless sensor with unknown values but its beam directions."""
        return cls(
            "",
            maker,
            elevation_deg,
            azimuth_offset_deg,
            columns,
            (columns,),
            rate_hz,
            (rate_hz,),
            range_min_m=None,
            range_max_m=None,
            reference_reflectivity=None,
            reference_range_m=None,
            range_sigma_m=None,
            range_resolution_m=None,
            wavelength_nm=None,
            spin="cw",
            sources={},
        )

    @property
    def channels(self) -> int:
        """Number of channels, C."""
        return len(self.elevation_deg)

    @property
    def column_rate_hz(self) -> float:
        """Columns per second in the default mode."""
        return self.columns * self.rate_hz

    @property
    def blocks(self) -> tuple[tuple[int, ...], ...] | None:
        """Channels that fire together, in firing order; ``None``: unknown."""
        if self.firing_time_us is None:
            return None
        times, block = np.unique(self.firing_time_us, return_inverse=True)
        return tuple(tuple(np.flatnonzero(block == n).tolist()) for n in range(len(times)))

    @property
    def firing_groups(self) -> int | None:
        """Number of firings per column; channels that fire together count once."""
        if self.firing_time_us is None:
            return None
        return len(np.unique(self.firing_time_us))

    @property
    def assumed_range_max_m(self) -> float:
        """``range_max_m``, or 100 m where it is not published."""
        return _ASSUMED_RANGE_MAX_M if self.range_max_m is None else self.range_max_m

    @property
    def assumed_range_min_m(self) -> float:
        """``range_min_m``, or 0.5 m where it is not published."""
        return _ASSUMED_RANGE_MIN_M if self.range_min_m is None else self.range_min_m

    @property
    def assumed_range_sigma_m(self) -> float:
        """Value of real units, else ``range_sigma_m``, else 7 mm.

        The centimetres that makers call accuracy include errors common to all ranges of a channel.
        Strong echoes of four real sensors scatter by 5 to 8 mm.
        """
        candidates = (self.measured_sigma_m, self.range_sigma_m, _ASSUMED_RANGE_SIGMA_M)
        return next(value for value in candidates if value is not None)

    @property
    def assumed_range_resolution_m(self) -> float:
        """``range_resolution_m``, or 1 mm where it is not published."""
        if self.range_resolution_m is None:
            return _ASSUMED_RANGE_RESOLUTION_M
        return self.range_resolution_m

    @property
    def assumed_wavelength_nm(self) -> float:
        """``wavelength_nm``, or 905 nm where it is not published."""
        return _ASSUMED_WAVELENGTH_NM if self.wavelength_nm is None else self.wavelength_nm

    @property
    def assumed_divergence_deg(self) -> tuple[float, float]:
        """Value of real units, else ``beam_divergence_deg``, else 0.18 by 0.09 degrees.

        The default is the VLS-128's, the only 905 nm sensor in the catalogue with a published
        divergence. With infinitely thin rays, thin objects get too few points
        (`docs/method/returns.md`).
        """
        published = self.beam_divergence_deg or _ASSUMED_DIVERGENCE_DEG
        return self.measured_divergence_deg or published

    @property
    def assumed_reference(self) -> tuple[float, float]:
        """Reflectivity and the range at which it is detected.

        If the maker publishes none, a 10 % target is assumed to be detected up to half of
        ``range_max_m``, as for the makers that publish both.
        """
        if self.reference_reflectivity is None or self.reference_range_m is None:
            return _ASSUMED_REFLECTIVITY, self.assumed_range_max_m / 2
        return self.reference_reflectivity, self.reference_range_m
