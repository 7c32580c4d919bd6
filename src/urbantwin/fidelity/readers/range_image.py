"""Points of a range image: one range for each beam and each step of a turn.

Source: the Waymo Open Dataset's ``range_image_utils.py`` (``compute_inclination``,
``compute_range_image_polar``, ``compute_range_image_cartesian``) and ``lidar_utils.py``. Rows are
beams, the highest first; columns are directions, from straight back counter-clockwise seen from
the last to the first: the middle is ahead in the vehicle's frame, whichever way the sensor is
turned. What moved while the sensor turned is put right by the vehicle's own pose at every pixel.
The kit counts in 32 bits, this in 64.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.geometry import Pose, rotation_from_ypr

__all__ = ["RangeImageSensor", "Returns", "returns_of"]

#: Beams are no steeper than straight up or down, radians (with what 32 bits lose).
_STEEPEST = np.pi / 2 + 1e-6


@dataclass(frozen=True, eq=False)
class RangeImageSensor:
    """Where a sensor is, and where its beams point.

    Attributes:
        vehicle_SE3_sensor: its extrinsics.
        inclination: (H,) radians above the sensor's x-y plane, the lowest first; None where they
            are spread evenly.
        lowest, highest: bounds of those that are spread evenly, radians.
    """

    vehicle_SE3_sensor: Pose  # noqa: N815
    inclination: NDArray[np.float64] | None
    lowest: float
    highest: float

    def of_rows(self, height: int) -> NDArray[np.float64]:
        """Return the inclination of every row (height,) of an image, the highest first.

        Raises:
            ValueError: the sensor has another number of beams, or one of no direction.
        """
        found = self.inclination
        if found is None:
            step = (np.arange(height) + 0.5) / height
            found = self.lowest + step * (self.highest - self.lowest)
        if len(found) != height:
            raise ValueError(f"{height} rows for {len(found)} beams")
        if not (np.abs(found) <= _STEEPEST).all():
            raise ValueError("a beam without a direction")
        return found[::-1]


@dataclass(frozen=True, eq=False)
class Returns:
    """What came back of one image: points (N, 3) in the vehicle's frame, row and column (N,)."""

    points: NDArray[np.float64]
    row: NDArray[np.intp]
    column: NDArray[np.intp]


def returns_of(
    range_m: NDArray[np.floating],
    sensor: RangeImageSensor,
    pixel_pose: NDArray[np.floating] | None = None,
    world_SE3_vehicle: Pose | None = None,
) -> Returns:
    """Return the points of an image, row by row: pixels whose range is above 0.

    Args:
        range_m: (H, W).
        sensor: whose image it is.
        pixel_pose: (H, W, 6) roll, pitch, yaw in radians and x, y, z in metres of the vehicle in
            the world at every pixel; needs the next.
        world_SE3_vehicle: of the frame, whose vehicle's frame the points are given in.

    Raises:
        ValueError: the image is not one of the sensor's.
    """
    height, width = range_m.shape
    inclination = sensor.of_rows(height)
    row, column = np.nonzero(range_m > 0)
    turned = sensor.vehicle_SE3_sensor.rotation
    ahead = np.arctan2(turned[1, 0], turned[0, 0])
    azimuth = np.pi - (column + 0.5) * (2 * np.pi / width) - ahead
    away, up = range_m[row, column].astype(np.float64), inclination[row]
    flat = away * np.cos(up)
    seen = np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), away * np.sin(up)])
    points = sensor.vehicle_SE3_sensor.apply(seen)
    if pixel_pose is not None and world_SE3_vehicle is not None:
        roll, pitch, yaw, *place = pixel_pose[row, column].astype(np.float64).T
        turn = rotation_from_ypr(yaw, pitch, roll)
        in_world = np.einsum("nij,nj->ni", turn, points) + np.column_stack(place)
        points = world_SE3_vehicle.inverse().apply(in_world)
    return Returns(points, row, column)
