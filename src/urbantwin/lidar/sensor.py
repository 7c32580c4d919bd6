"""A LiDAR's datasheet: where its beams point, when they fire, range, noise and intensity.

Signs. Elevation is positive up. An azimuth offset is **counter-clockwise positive** seen from
above, in the sensor frame (x forward, y left, z up), whatever the maker's own convention:

- Velodyne calibration files: the driver (ros-drivers/velodyne ``rawdata.cc``) computes the
  direction at clockwise angle ``encoder - rot_correction``, so our offset is ``+rot_correction``.
- Hesai correction files: the driver (HesaiLidar_General_ROS ``pandarGeneral_internal.cc``) adds
  the file's azimuth to a clockwise encoder angle, so our offset is ``-Azimuth``.
- Ouster metadata: the sensor's manual ("Lidar Range to XYZ") turns counter-clockwise by
  ``-beam_azimuth_angles``, so our offset is ``-beam_azimuth_angles``.

``None`` means that the number is not known: ``Sensor.unknown`` says why. Consumers that need one
all the same use the documented fallbacks ``Sensor.assumed_*``.
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
    """A spinning LiDAR: where its beams point and what its maker says of its ranges.

    Attributes:
        name: the model's name.
        maker: who makes it.
        elevation_deg: (C,) float64, elevation of each channel, degrees, positive up, in the
            order in which the maker numbers the channels.
        azimuth_offset_deg: (C,) float64, direction of each channel relative to the encoder's
            angle, degrees, counter-clockwise positive.
        columns: firings per turn by default.
        columns_options: every number of firings per turn that the sensor offers.
        rate_hz: turns per second by default.
        rate_options: every rate that the sensor offers.
        range_min_m: nearest distance that is measured.
        range_max_m: farthest distance that is reported.
        reference_reflectivity: diffuse reflectivity (0..1) that ``reference_range_m`` is for.
        reference_range_m: distance up to which such a target is detected.
        range_sigma_m: standard deviation of one distance measurement.
        range_resolution_m: step of the reported distance.
        wavelength_nm: of the laser.
        spin: ``cw`` or ``ccw`` seen from above.
        sources: field -> document that the value is from.
        aliases: other names of the model.
        modes: pairs of columns and turns per second that the sensor offers together.
        firing_time_us: (C,) float64, when each channel fires, microseconds after the first
            instant that the maker counts the column's time from; equal times fire together.
        firing_sequence_us: time from one firing of a channel to its next, where it is fixed and
            does not follow from the mode.
        azimuth_step_deg: step of the reported azimuth.
        beam_divergence_deg: full width of the beam at half maximum, horizontal and vertical,
            degrees; a maker's figure that does not say at which level is taken as that.
        return_modes: which returns the sensor can report.
        intensity_scale: what the reported intensity means.
        intensity_of_white: reported for a diffuse reflectivity of 100 %.
        intensity_max: greatest value that is reported.
        detection_range_10_m: distance up to which a diffuse target of 10 % is detected.
        detection_range_80_m: distance up to which a diffuse target of 80 % is detected.
        beam_origin_m: how far from the axis the beams leave, metres.
        measured_light: times the light that the datasheet's ranges mean, of units in the field.
        measured_sigma_m: standard deviation of strong echoes' ranges, of units in the field.
        measured_faintest: share of white of which half is missed next to the sensor, of units in
            the field.
        measured_divergence_deg: as ``beam_divergence_deg``, of units in the field.
        weak_sigma_m: standard deviation of ranges of the datasheet's 10 % target, at its range.
        overlap_m: distance at which half of what a near target sends back is collected.
        measured_code_scale: times the reflectivity that codes should mean, of units in the field.
        pattern: where the beams point by time, of a sensor whose pattern does not repeat with the
            frame; its channels are then the pattern's lines, at their mean elevation, and its
            columns the points of a line in a frame.
        points_per_second: of all lines of such a sensor.
        unknown: field -> why its value is not known.
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
        """Return a sensor without a name, of which nothing is known but where its beams point."""
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
        """Channels that fire together, in the order in which they do; ``None``: unknown."""
        if self.firing_time_us is None:
            return None
        times, block = np.unique(self.firing_time_us, return_inverse=True)
        return tuple(tuple(np.flatnonzero(block == n).tolist()) for n in range(len(times)))

    @property
    def firing_groups(self) -> int | None:
        """How many times a column fires; channels that fire together count once."""
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
        """What was measured of units, else ``range_sigma_m``, else 7 mm.

        The centimetres that makers call accuracy hold what all ranges of a channel share, too.
        Strong echoes of the four sensors that were measured scatter by 5 to 8 mm.
        """
        known = (self.measured_sigma_m, self.range_sigma_m, _ASSUMED_RANGE_SIGMA_M)
        return next(one for one in known if one is not None)

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
        """What was measured of units, else ``beam_divergence_deg``, else 0.18 by 0.09 degrees.

        Those are the VLS-128's, the only sensor of 905 nm in the catalogue whose maker states it.
        As thin rays, beams give too few points of what is thin (`docs/method/returns.md`).
        """
        published = self.beam_divergence_deg or _ASSUMED_DIVERGENCE_DEG
        return self.measured_divergence_deg or published

    @property
    def assumed_reference(self) -> tuple[float, float]:
        """Reflectivity and the distance up to which it is detected.

        Where the maker publishes none, a 10 % target is taken to be seen up to half of
        ``range_max_m``: about what the makers that publish both state.
        """
        if self.reference_reflectivity is None or self.reference_range_m is None:
            return _ASSUMED_REFLECTIVITY, self.assumed_range_max_m / 2
        return self.reference_reflectivity, self.reference_range_m
