"""A real roadside VLS-128 against the catalogue's: beams, columns, range step, reach on the road.

New Brunswick: a matrix of background ranges (128 beams by 0.2 degrees, of many frames) and the
foreground points of five frames. The sensor's height and heading are unknown, so nothing of the
place is simulated; what the data say of the sensor itself is compared.

- Elevations: the data's table, and every foreground point, against the catalogue's channels.
- Azimuth offsets: with its channel's offset taken off, a point's azimuth is that of the encoder.
  The points of all channels then stand in columns that have no width at all; with no offsets,
  or with their signs turned, they do not.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from urbantwin.lidar import sensor

GAP_DEG = 0.05


def foreground_points(path: Path) -> np.ndarray:
    """(N, 3) of a frame's PLY, each once."""
    raw = path.read_bytes()
    start = raw.index(b"end_header\n") + len(b"end_header\n")
    header = raw[:start].decode()
    count = int(header.split("element vertex ")[1].split()[0])
    table = np.frombuffer(raw, "<f4", count * header.count("property float"), start)
    return np.unique(table.reshape(count, -1)[:, :3].astype(np.float64), axis=0)


def channels_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The channel whose elevation is nearest to each point's, and how far that is, degrees."""
    elevation = np.degrees(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1)))
    table = sensor("VLS-128").elevation_deg
    order = np.argsort(table)
    borders = (table[order][1:] + table[order][:-1]) / 2
    channel = order[np.searchsorted(borders, elevation)]
    return channel, np.abs(elevation - table[channel])


def columns_of(points: np.ndarray, channel: np.ndarray, offset_deg: np.ndarray) -> dict:
    """How the encoder's angles gather: groups that `GAP_DEG` parts, their widths and distances."""
    clockwise = np.degrees(np.arctan2(points[:, 0], points[:, 1]))
    encoder = np.sort((clockwise + offset_deg[channel]) % 360.0)
    groups = np.split(encoder, np.flatnonzero(np.diff(encoder) > GAP_DEG) + 1)
    middles = [group.mean() for group in groups]
    return {
        "columns": len(groups),
        "widest_deg": float(max(np.ptp(group) for group in groups)),
        "spacing_deg": float(np.median(np.diff(middles))),
    }


def measure(folder: Path) -> dict:
    catalogue = sensor("VLS-128")
    table = np.degrees(loadmat(folder / "beams_elevation.mat")["beams_elevation"].ravel())
    frames = []
    for path in sorted((folder / "foreground").glob("*.ply")):
        points = foreground_points(path)
        channel, apart = channels_of(points)
        steps = np.linalg.norm(points, axis=1) / catalogue.range_resolution_m
        offset = catalogue.azimuth_offset_deg
        frames.append(
            {
                "frame": path.stem,
                "points": len(points),
                "channels": len(np.unique(channel)),
                "elevation_error_deg": float(apart.max()),
                "off_range_step": float(np.abs(steps - np.rint(steps)).max()),
                "columns": columns_of(points, channel, offset),
                "columns_without_offsets": columns_of(points, channel, 0 * offset),
                "columns_with_signs_turned": columns_of(points, channel, -offset),
            }
        )
    return {
        "table_error_deg": float(np.abs(np.sort(table) - np.sort(catalogue.elevation_deg)).max()),
        "frames": frames,
    }
