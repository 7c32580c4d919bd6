"""A real roadside VLS-128 against the catalogue's: beams, columns, range step, reach on the road.

New Brunswick: a matrix of background ranges (128 beams by 0.2 degrees, of many frames) and the
foreground points of five frames. The sensor's height and heading are unknown, so nothing of the
place is simulated; what the data say of the sensor itself is compared.

- Elevations: the data's table, and every foreground point, against the catalogue's channels.
- Azimuth offsets: with its channel's offset taken off, a point's azimuth is that of the encoder.
  The points of all channels then stand in columns that have no width at all; with no offsets,
  or with their signs turned, they do not.
- Reach: of the cells that look at the road and are not blocked, how many have a background range.
  The matrix sums up many frames, so a cell is there if it ever returned: a bound, no rate.

    python benchmarks/newbrunswick.py
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from urbantwin.lidar import sensor

DATA = Path(__file__).parents[2] / "shared/data/lidar/newbrunswick-roadside"
COLUMN_DEG = 0.2  #: of the matrix
GAP_DEG = 0.05
REACH_M = (20, 40, 60, 80, 100, 120, 140, 160, 180, 200)


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


def plane_of_road(places: np.ndarray, seed: int = 0, tries: int = 4000) -> np.ndarray:
    """Unit normal and offset of the plane that holds most points within 15 cm (RANSAC)."""
    generator = np.random.default_rng(seed)
    best, found = 0, np.zeros(4)
    for _ in range(tries):
        a, b, c = places[generator.choice(len(places), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal)
        if length < 1.0 or abs(normal[2]) < 0.98 * length:
            continue
        normal *= np.sign(normal[2]) / length
        count = int((np.abs((places - a) @ normal) < 0.15).sum())
        if count > best:
            best, found = count, np.array([*normal, a @ normal])
    return found


def reach_on_road(ranges: np.ndarray, elevation_deg: np.ndarray) -> tuple[float, list[dict]]:
    """Height of the sensor over the road's plane, and by distance how many cells see the road."""
    azimuth = np.radians((np.arange(ranges.shape[1]) + 0.5) * COLUMN_DEG)
    up = np.radians(elevation_deg)[:, None]
    aim = np.stack(
        [np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up) + 0 * azimuth],
        axis=-1,
    )
    seen = ranges > 0
    low = seen & (up < np.radians(-2)) & (ranges > 6) & (ranges < 100)
    plane = plane_of_road((aim * ranges[..., None])[low])
    slope = aim @ plane[:3]
    with np.errstate(divide="ignore"):
        expected = np.where(slope < 0, plane[3] / np.minimum(slope, -1e-9), np.inf)
    high = ranges * slope - plane[3]
    road = seen & (np.abs(high) < 0.15 + 0.008 * ranges)
    # Columns along which the road goes on for 80 m or more.
    farthest = np.where(road & (expected < 400), expected, 0).max(axis=0)
    rows = []
    for near, far in itertools.pairwise(REACH_M):
        here = (expected >= near) & (expected < far) & (farthest > 80)[None, :]
        rows.append(
            {
                "range_m": [near, far],
                "road": int((here & road).sum()),
                "nothing": int((here & ~seen).sum()),
            }
        )
    return -float(plane[3]), rows


def measure(folder: Path = DATA) -> dict:
    catalogue = sensor("VLS-128")
    table = np.degrees(loadmat(folder / "beams_elevation.mat")["beams_elevation"].ravel())
    ranges = loadmat(folder / "range_thrld_matrix.mat")["range_thrld_matrix"]
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
    height, reach = reach_on_road(ranges, table)
    return {
        "table_error_deg": float(np.abs(np.sort(table) - np.sort(catalogue.elevation_deg)).max()),
        "frames": frames,
        "height_over_road_m": height,
        "reach": reach,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if not given.data.is_dir():
        sys.exit(f"the real data are not here: {given.data}")
    result = measure(given.data)
    if given.json:
        print(json.dumps(result, indent=2))
        return
    print(f"largest error of the table of elevations: {result['table_error_deg']:.6f} deg")
    for frame in result["frames"]:
        print(
            f"  {frame['frame']}: {frame['points']} points of {frame['channels']} channels, "
            f"elevation within {frame['elevation_error_deg']:.5f} deg, "
            f"range within {frame['off_range_step']:.3f} of a step"
        )
        for key, name in (
            ("columns", "offsets of the catalogue"),
            ("columns_without_offsets", "no offsets"),
            ("columns_with_signs_turned", "signs turned"),
        ):
            found = frame[key]
            print(
                f"    {name:25}: {found['columns']:5d} columns, widest "
                f"{found['widest_deg']:8.4f} deg, {found['spacing_deg']:.3f} deg apart"
            )
    print(f"the sensor stands {result['height_over_road_m']:.2f} m over the road")
    for row in result["reach"]:
        near, far = row["range_m"]
        cells = f"{row['road']:5d} cells see the road, {row['nothing']:3d} see nothing"
        print(f"  {near:4d} to {far:4d} m: {cells}")


if __name__ == "__main__":
    main()
