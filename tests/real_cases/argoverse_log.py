"""The Argoverse 2 log of Pittsburgh as its two VLP-32C fired it: every ray, returned or not.

The published points are moved to where the vehicle was at the sweep's time and rounded to half
precision. Undone with the poses and the firing times, each point is back in its sensor's frame:
its elevation tells its channel, its time tells its firing cycle (they run freely, 55.296 us each)
and the points of all channels together tell where the encoder stood at every cycle. So the rays
that returned nothing are known too.

The vehicle frame at a sweep's time (x forward, y left, z up) serves as the site frame.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.feather
import shapely
from numpy.typing import NDArray
from scipy.ndimage import convolve
from scipy.spatial.transform import Rotation, Slerp

from urbantwin.geometry import Pose
from urbantwin.lidar import Sensor, sensor

__all__ = ["SENSORS", "ActorBox", "Log", "RealRays", "vlp32c"]

#: Name, lasers in the file, and how it turns in its own frame: the lower one hangs upside down.
SENSORS = (("up_lidar", 0, "cw"), ("down_lidar", 32, "ccw"))
CYCLE_S = 55.296e-6
#: Cycles in a turn at 10 Hz.
COLUMNS = 1808
RATE = 2 * np.pi * 10.0


def vlp32c(spin: str) -> Sensor:
    """The catalogue's sensor with as many columns as its cycles make at 10 Hz."""
    return replace(
        sensor("VLP-32C"),
        spin=spin,  # type: ignore[arg-type]
        columns=COLUMNS,
        columns_options=(COLUMNS,),
        modes=((COLUMNS, 10.0),),
    )


@dataclass(frozen=True, eq=False)
class RealRays:
    """One turn of one sensor: C channels x M firing cycles.

    Attributes:
        range_m: (C, M), nan where nothing returned.
        intensity: (C, M), 0 to 255; nan where nothing returned.
        points_m: (C, M, 3), vehicle frame at the sweep's time; nan likewise.
        encoder_rad: (M,) where the encoder stood when each cycle began, as the sensor turns,
            0 to 2 pi.
        time_s: (C, M) when each ray fired, seconds after the sweep's time.
        elevation_deg: (C,) of the catalogue's beams.
        elevation_error_deg: (C,) median elevation of a channel's points less the catalogue's.
        off_schedule_us: how far the points' times are from the catalogue's, at most.
        off_encoder_deg: how far the points' azimuths are from encoder and offset, 95 of 100.
    """

    range_m: NDArray[np.float64]
    intensity: NDArray[np.float64]
    points_m: NDArray[np.float64]
    encoder_rad: NDArray[np.float64]
    time_s: NDArray[np.float64]
    elevation_deg: NDArray[np.float64]
    elevation_error_deg: NDArray[np.float64]
    off_schedule_us: float
    off_encoder_deg: float

    @property
    def column(self) -> NDArray[np.int64]:
        """The simulated column (M,) that fires nearest to where the encoder stood."""
        return np.rint(self.encoder_rad / (2 * np.pi) * COLUMNS).astype(np.int64) % COLUMNS

    @property
    def phase_deg(self) -> float:
        """Where the encoder stood at the sweep's time."""
        start = float(self.time_s[:, 0].min())
        return float(np.degrees(self.encoder_rad[0] - RATE * start) % 360.0)


@dataclass(frozen=True, eq=False)
class ActorBox:
    """An annotated box in the vehicle frame at the sweep's time.

    The box of what moves was drawn around its points, so it is where they were measured.

    Attributes:
        category: the log's class.
        name: of its track.
        size: (3,) length, width, height.
        pose: of its middle.
        velocity: (3,) by the boxes of the track before and after.
        observed_s: when its points were measured on average, seconds after the sweep's time.
        intensity: median of its points that are not near the ground, 0 to 255; nan without any.
        mesh: which one of our catalogue fills it; the one of the nearest proportions if not given.
        panes: whether its panes are of glass.
    """

    category: str
    name: str
    size: NDArray[np.float64]
    pose: Pose
    velocity: NDArray[np.float64]
    observed_s: float
    intensity: float
    mesh: str | None = None
    panes: bool = True

    @property
    def coat(self) -> str:
        """Which of our coats of vehicles comes nearest to how bright it is."""
        return "white" if self.intensity > 30 else "grey" if self.intensity > 6 else "black"

    def holds(self, points: NDArray[np.floating], grown_m: float = 0.0) -> NDArray[np.bool_]:
        """Which of (N, 3) points lie inside the box, grown to all sides."""
        half = self.size / 2 + grown_m
        off = points[:, 0] - self.pose.translation[0]
        near = np.flatnonzero(np.abs(off) <= np.linalg.norm(half))
        found = np.zeros(len(points), bool)
        found[near] = (np.abs(self.pose.inverse().apply(points[near])) <= half).all(axis=1)
        return found


class Log:
    """The log. Poses are interpolated between those that the vehicle recorded."""

    def __init__(self, folder: Path) -> None:
        self.folder = next(path for path in folder.iterdir() if path.is_dir())
        poses = self._table("city_SE3_egovehicle.feather")
        poses = poses.drop_duplicates("timestamp_ns").sort_values("timestamp_ns")
        self._start = int(poses.timestamp_ns.iloc[0])
        self._time = (poses.timestamp_ns.to_numpy() - self._start) * 1e-9
        self._turn = Slerp(self._time, Rotation.from_quat(poses[["qx", "qy", "qz", "qw"]]))
        self._place = poses[["tx_m", "ty_m", "tz_m"]].to_numpy()
        self.sweeps = sorted(int(path.stem) for path in self.folder.glob("sensors/lidar/*.feather"))

    def _table(self, name: str) -> Any:
        return pyarrow.feather.read_table(self.folder / name).to_pandas()

    def city_of_vehicle(self, times: NDArray[np.int64]) -> tuple[Rotation, NDArray[np.float64]]:
        """The vehicle's poses at times in nanoseconds."""
        at = (times - self._start) * 1e-9
        place = [np.interp(at, self._time, self._place[:, k]) for k in range(3)]
        return self._turn(at), np.column_stack(place)

    def vehicle_path(self, sweep: int, seconds: NDArray[np.float64]) -> list[Pose]:
        """The vehicle's poses at seconds after a sweep, in its own frame at the sweep's time."""
        turn, place = self.city_of_vehicle(sweep + np.rint(seconds * 1e9).astype(np.int64))
        first, origin = self.city_of_vehicle(np.array([sweep]))
        relative = (first[0].inv() * turn).as_matrix()
        moved = first[0].inv().apply(place - origin)
        return [Pose(r, t) for r, t in zip(relative, moved, strict=True)]

    @cached_property
    def mounts(self) -> dict[str, Pose]:
        """Poses of the sensors on the vehicle."""
        table = self._table("calibration/egovehicle_SE3_sensor.feather").set_index("sensor_name")
        return {
            name: Pose(
                Rotation.from_quat(row[["qx", "qy", "qz", "qw"]].to_numpy(float)).as_matrix(),
                row[["tx_m", "ty_m", "tz_m"]].to_numpy(float),
            )
            for name, row in table.iterrows()
        }

    def points(self, sweep: int) -> NDArray[np.float64]:
        """All points (N, 3) of a sweep, vehicle frame."""
        table = self._table(f"sensors/lidar/{sweep}.feather")
        return np.asarray(table[["x", "y", "z"]].to_numpy(np.float64, copy=True))

    def lasers(self, sweep: int) -> NDArray[np.int64]:
        """Which laser (N,) measured each point of a sweep."""
        table = self._table(f"sensors/lidar/{sweep}.feather")
        return np.asarray(table.laser_number.to_numpy(np.int64))

    def rays(self, sweep: int, name: str) -> RealRays:
        """One sensor's rays of a sweep."""
        _, first, spin = next(one for one in SENSORS if one[0] == name)
        model = vlp32c(spin)
        table = self._table(f"sensors/lidar/{sweep}.feather")
        table = table[(table.laser_number >= first) & (table.laser_number < first + model.channels)]
        points = table[["x", "y", "z"]].to_numpy(np.float64, copy=True)
        time_s = table.offset_ns.to_numpy() * 1e-9
        seen = self._in_sensor(sweep, name, points, time_s)
        range_m = np.linalg.norm(seen, axis=1)
        elevation = np.degrees(np.arcsin(seen[:, 2] / range_m))

        laser = table.laser_number.to_numpy() - first
        median = np.array([np.median(elevation[laser == k]) for k in range(model.channels)])
        channel_of = np.abs(median[:, None] - model.elevation_deg).argmin(axis=1)
        channel = channel_of[laser]
        error = np.empty(model.channels)
        error[channel_of] = median - model.elevation_deg[channel_of]

        assert model.firing_time_us is not None
        firing = model.firing_time_us * 1e-6
        begun = time_s - firing[channel]
        phase = np.angle(np.exp(2j * np.pi * begun / CYCLE_S).mean()) / (2 * np.pi) * CYCLE_S
        cycle = np.rint((begun - phase) / CYCLE_S).astype(int)
        late = begun - phase - cycle * CYCLE_S
        low, count = cycle.min(), int(np.ptp(cycle)) + 1
        start = phase + (low + np.arange(count)) * CYCLE_S
        cycle -= low

        turn = -1.0 if spin == "cw" else 1.0
        azimuth = np.arctan2(seen[:, 1], seen[:, 0]) - np.radians(model.azimuth_offset_deg[channel])
        # The head goes on turning while a cycle's channels fire one after another.
        angle = turn * azimuth - RATE * firing[channel]
        encoder, off = encoder_of_cycles(angle, cycle, count, range_m > 10.0)
        image = np.full((model.channels, count, 5), np.nan)
        image[channel, cycle] = np.column_stack([range_m, table.intensity, points])
        return RealRays(
            image[..., 0],
            image[..., 1],
            image[..., 2:],
            encoder % (2 * np.pi),
            start + firing[:, None],
            model.elevation_deg,
            error,
            float(np.abs(late).max() * 1e6),
            float(np.degrees(np.percentile(np.abs(off), 95))),
        )

    def _in_sensor(
        self, sweep: int, name: str, points: NDArray[np.float64], time_s: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Points of the vehicle frame at the sweep's time in the sensor's at their firing."""
        first, origin = self.city_of_vehicle(np.array([sweep]))
        turn, place = self.city_of_vehicle(sweep + np.rint(time_s * 1e9).astype(np.int64))
        vehicle = turn.inv().apply(first[0].apply(points) + origin - place)
        return self.mounts[name].inverse().apply(vehicle)

    def boxes(self, sweep: int) -> Iterator[ActorBox]:
        """The annotated boxes that hold points."""
        table = self._table("annotations.feather")
        points = self.points(sweep)
        returns = self._table(f"sensors/lidar/{sweep}.feather")
        time_s = returns.offset_ns.to_numpy() * 1e-9
        intensity = returns.intensity.to_numpy().astype(np.float64)
        inverse, origin = self.city_of_vehicle(np.array([sweep]))
        for row in table[(table.timestamp_ns == sweep) & (table.num_interior_pts > 0)].itertuples():
            track = table[table.track_uuid == row.track_uuid].sort_values("timestamp_ns")
            near = track[np.abs(track.timestamp_ns - sweep) < 1.5e8]
            times = near.timestamp_ns.to_numpy()
            turn, place = self.city_of_vehicle(times)
            centre = (
                inverse[0]
                .inv()
                .apply(
                    turn.apply(near[["tx_m", "ty_m", "tz_m"]].to_numpy(copy=True)) + place - origin
                )
            )
            moved = centre[-1] - centre[0]
            velocity = moved / max((times[-1] - times[0]) * 1e-9, 1e-3)
            rotation = Rotation.from_quat([row.qx, row.qy, row.qz, row.qw]).as_matrix()
            size = np.array([row.length_m, row.width_m, row.height_m])
            pose = Pose(rotation, np.array([row.tx_m, row.ty_m, row.tz_m]))
            box = ActorBox(row.category, row.track_uuid, size, pose, velocity, 0.0, np.nan)
            inside = box.holds(points)
            raised = inside & (points[:, 2] > pose.translation[2] - size[2] / 2 + 0.35)
            yield replace(
                box,
                observed_s=float(time_s[inside].mean()),
                intensity=float(np.median(intensity[raised])) if raised.any() else np.nan,
            )

    def drivable(self, sweep: int, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which points (N, 3) of the vehicle frame lie on what the map calls drivable."""
        turn, origin = self.city_of_vehicle(np.array([sweep]))
        city = turn[0].apply(points) + origin
        return np.asarray(shapely.contains_xy(self._drivable, city[:, 0], city[:, 1]))

    @cached_property
    def _drivable(self) -> shapely.Geometry:
        """The map's drivable areas less 30 cm along their borders, city frame."""
        found = json.loads(next(self.folder.glob("map/log_map_archive*.json")).read_text())
        rings = [
            [(corner["x"], corner["y"]) for corner in one["area_boundary"]]
            for one in found["drivable_areas"].values()
        ]
        area = shapely.union_all([shapely.make_valid(shapely.Polygon(ring)) for ring in rings])
        area = area.buffer(-0.3)
        shapely.prepare(area)
        return area

    @cached_property
    def heights(self) -> NDArray[np.float64]:
        """The measured ground (rows, columns), from the south-west; nan where it is not known."""
        return unrounded(np.load(next(self.folder.glob("map/*ground_height*.npy"))))

    @cached_property
    def _city_ground(self) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """The measured ground as vertices (V, 3), city frame, and faces (F, 3)."""
        sim2 = json.loads(next(self.folder.glob("map/*Sim2*.json")).read_text())
        heights = self.heights
        rows, columns = heights.shape
        row, column = np.indices(heights.shape)
        xy = (np.column_stack([column.ravel(), row.ravel()]) + 0.5) / sim2["s"] - sim2["t"]
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        known = np.isfinite(heights.ravel())
        square = [corner, corner + 1, corner + columns + 1, corner + columns]
        kept = np.logical_and.reduce([known[k] for k in square])
        a, b, c, d = (k[kept] for k in square)
        faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
        city = np.column_stack([xy, np.nan_to_num(heights.ravel())])
        return city, faces.astype(np.int32)

    def ground(
        self, sweep: int, farthest_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """The measured ground near the vehicle: vertices (V, 3), vehicle frame; faces (F, 3)."""
        city, faces = self._city_ground
        turn, origin = self.city_of_vehicle(np.array([sweep]))
        near = np.hypot(*(city - origin)[:, :2].T) < farthest_m
        number = np.cumsum(near, dtype=np.int32) - 1
        kept = number[faces[near[faces].all(axis=1)]]
        return turn[0].inv().apply(city[near] - origin), kept


def unrounded(raster: NDArray[np.floating], passes: int = 200) -> NDArray[np.float64]:
    """The smoothest heights that round to those of a raster in half precision.

    Between 64 and 128 m half precision counts in steps of 6.25 cm: taken as they are, the heights
    make stairs of a sloping road.
    """
    known = np.isfinite(raster)
    heights = np.where(known, raster, 0).astype(np.float64)
    half_step = np.spacing(np.where(known, np.abs(raster), 0)).astype(np.float64) / 2
    low, high = heights - half_step, heights + half_step
    kernel = np.ones((3, 3))
    count = np.maximum(convolve(known.astype(np.float64), kernel, mode="constant"), 1)
    for _ in range(passes):
        mean = convolve(heights, kernel, mode="constant") / count
        heights = np.where(known, np.clip(mean, low, high), 0)
    return np.where(known, heights, np.nan)


def encoder_of_cycles(
    angle: NDArray[np.float64], cycle: NDArray[np.int64], count: int, exact: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the encoder stood at each of ``count`` cycles, and how far the points are from it.

    A straight line in time, corrected by the median over every 25 cycles: no motor turns evenly.
    """
    rate = RATE * CYCLE_S
    origin = np.angle(np.exp(1j * (angle - rate * cycle)).mean())
    off = np.angle(np.exp(1j * (angle - origin - rate * cycle)))
    bins = np.arange(0, count + 25, 25)
    place = np.digitize(cycle, bins)
    used = [k for k in np.unique(place) if (exact & (place == k)).sum() > 20]
    middle = [cycle[exact & (place == k)].mean() for k in used]
    median = [np.median(off[exact & (place == k)]) for k in used]
    correction = np.interp(np.arange(count), middle, median)
    encoder = origin + rate * np.arange(count) + correction
    return encoder, np.angle(np.exp(1j * (angle - encoder[cycle])))[exact]
