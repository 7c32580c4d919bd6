"""Published poses of a preset's sensors, brought to the site."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pyproj import Transformer

from urbantwin.geometry import Pose, SiteFrame, ypr_from_rotation
from urbantwin.site.presets.preset import PresetFrame, PresetSensor

__all__ = ["SensorPosition", "site_SE3_frame", "site_position"]

#: East and north of each direction of a map's grid.
_GRID = {"east": (1.0, 0.0), "north": (0.0, 1.0), "west": (-1.0, 0.0), "south": (0.0, -1.0)}
#: Over this length the direction of a grid's north is found, metres.
_ALONG_M = 100.0


@dataclass(frozen=True)
class SensorPosition:
    """Where a sensor stands on the site, as `site.rig` has it: metres and degrees.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of it.
        up_m: metres above the anchor's ground; ``None``: ``height_m`` is known instead.
        height_m: metres above the ground there.
        yaw_deg: counter-clockwise from east; ``None``: not known.
        pitch_deg: positive looks down.
        roll_deg: about the sensor's x.
    """

    east_m: float
    north_m: float
    up_m: float | None
    height_m: float | None
    yaw_deg: float | None
    pitch_deg: float
    roll_deg: float


def site_SE3_frame(frame: PresetFrame, site: SiteFrame) -> Pose:  # noqa: N802
    """Return where a preset's frame lies in the site frame.

    A grid's north is not true north: the frame is turned by the grid's convergence there. The
    grid's scale, 1 in a few thousand, is left out: rigs are a few metres wide.
    """
    to_lonlat = Transformer.from_crs(frame.crs, "EPSG:4326", always_xy=True)
    x_axis = np.array(_GRID[frame.axes[0]])
    ends = np.array([frame.origin_m, np.asarray(frame.origin_m) + _ALONG_M * x_axis])
    origin, along = site.site_from_lonlat(np.column_stack(to_lonlat.transform(*ends.T)))
    east, north = along - origin
    return Pose.from_ypr([*origin, 0.0], yaw=float(np.arctan2(north, east)))


def site_position(
    sensor: PresetSensor, frame: PresetFrame | None, site: SiteFrame
) -> SensorPosition:
    """Return where a sensor stands whose place is published.

    Args:
        sensor: of a preset; it has a pose, or a place on the site.
        frame: the preset's frame.
        site: the site frame.
    """
    if sensor.frame_SE3_sensor is not None and frame is not None:
        matrix = np.array(sensor.frame_SE3_sensor)
        # Published with eight digits: the nearest rotation.
        u, _, vt = np.linalg.svd(matrix[:, :3])
        pose = site_SE3_frame(frame, site) @ Pose(u @ vt, matrix[:, 3])
        yaw, pitch, roll = np.degrees(ypr_from_rotation(pose.rotation)).tolist()
        x, y, z = pose.translation.tolist()
        return SensorPosition(x, y, z, None, yaw, pitch, roll)
    assert sensor.east_m is not None
    assert sensor.north_m is not None
    return SensorPosition(
        sensor.east_m,
        sensor.north_m,
        None,
        sensor.height_m,
        None,
        sensor.pitch_deg,
        sensor.roll_deg,
    )
