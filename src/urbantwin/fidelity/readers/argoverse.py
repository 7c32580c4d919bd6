"""Argoverse 2 sensor logs: sweeps in feather, cuboids, poses and sensor positions.

Source: Wilson et al. 2021, "Argoverse 2", and the av2-api's user guide. Points and cuboids are in
the vehicle's frame (x forward, y left, z up), compensated for its motion; lasers 0 to 31 are the
upper sensor's, 32 to 63 the lower one's.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import read_feather
from urbantwin.errors import InputError
from urbantwin.fidelity.clouds import counting_order
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of, track_of
from urbantwin.fidelity.readers.recording import Recording
from urbantwin.geometry import Pose
from urbantwin.io.poses import heading, pose_of_quaternion
from urbantwin.io.trust import laid_out

__all__ = ["is_argoverse", "open_argoverse"]

_EXPECTED = "a log of Argoverse 2"
_SENSORS = ("up_lidar", "down_lidar")
_LASERS = 32
#: Maximum interval between boxes of a track for its velocity, nanoseconds.
_APART_NS = 350_000_000
_QUATERNION = ("qw", "qx", "qy", "qz")
_PLACE = ("tx_m", "ty_m", "tz_m")

Columns = dict[str, NDArray[Any]]


def is_argoverse(path: Path) -> bool:
    """Return whether a folder is a log."""
    return any((path / "sensors" / "lidar").glob("*.feather"))


def open_argoverse(path: Path) -> Recording:
    """Open a log; cuboids, poses and sensor positions are optional.

    Raises:
        InputError: a table is not readable.
    """
    files = sorted((path / "sensors" / "lidar").glob("*.feather"), key=counting_order)
    annotations = _table(path / "annotations.feather")
    poses = _table(path / "city_SE3_egovehicle.feather")
    sensors = _table(path / "calibration" / "egovehicle_SE3_sensor.feather")
    places = None if sensors is None else _places(path, sensors)

    def read(index: int) -> Frame:
        file = files[index]
        if not file.stem.isdigit():
            raise InputError("is not named by its time", file=file, expected="nanoseconds")
        time_ns = int(file.stem)
        fields = _table(file)
        assert fields is not None
        given: Columns = {}
        with laid_out(file, _EXPECTED):
            if "laser_number" in fields:
                given["sensor"] = fields["laser_number"] // _LASERS
            if "offset_ns" in fields:
                given["time_s"] = fields["offset_ns"] * 1e-9
        world = _pose_at(path, poses, time_ns)
        return frame_of(
            file,
            fields,
            name=file.stem,
            given=given,
            boxes=None
            if annotations is None
            else _boxes_at(path, annotations, time_ns, partial(_pose_at, path, poses), world),
            world_SE3_frame=world,
            sensor_places=np.zeros((1, 3)) if places is None else places,
        )

    return Recording(path, "argoverse2", tuple(file.stem for file in files), read)


def _table(path: Path) -> Columns | None:
    if not path.is_file():
        return None
    table = read_feather(path, _EXPECTED)
    with laid_out(path, _EXPECTED):
        return {name: table[name].to_numpy() for name in table.column_names}


def _row_pose(table: Columns, row: int) -> Pose:
    w, x, y, z = (float(table[name][row]) for name in _QUATERNION)
    return pose_of_quaternion(w, x, y, z, [float(table[name][row]) for name in _PLACE])


def _places(path: Path, sensors: Columns) -> NDArray[np.float64] | None:
    with laid_out(path / "calibration" / "egovehicle_SE3_sensor.feather", _EXPECTED):
        names = list(sensors["sensor_name"])
        if not all(name in names for name in _SENSORS):
            return None
        return np.array([_row_pose(sensors, names.index(name)).translation for name in _SENSORS])


def _pose_at(path: Path, poses: Columns | None, time_ns: int) -> Pose | None:
    """Return the pose at a sweep's time; the log has one for each sweep."""
    if poses is None:
        return None
    with laid_out(path / "city_SE3_egovehicle.feather", _EXPECTED):
        rows = np.flatnonzero(poses["timestamp_ns"] == time_ns)
        return _row_pose(poses, int(rows[0])) if len(rows) else None


def _boxes_at(
    path: Path,
    annotations: Columns,
    time_ns: int,
    pose_at: Callable[[int], Pose | None],
    world: Pose | None,
) -> Boxes | None:
    with laid_out(path / "annotations.feather", _EXPECTED):
        rows = np.flatnonzero(annotations["timestamp_ns"] == time_ns)
        if not len(rows):
            return None  # not a labelled sweep; an empty street has no rows either
        velocities = _velocities(annotations, time_ns, rows, pose_at, world)
        labelled = []
        for row, velocity in zip(rows, velocities, strict=True):
            pose = _row_pose(annotations, int(row))
            size = (float(annotations[f"{side}_m"][row]) for side in ("length", "width", "height"))
            labelled.append(
                LabelledBox(
                    (*pose.translation.tolist(), *size, heading(pose.rotation)),
                    str(annotations["category"][row]),
                    track_of(str(annotations["track_uuid"][row])),
                    velocity,
                )
            )
        return boxes_of(labelled)


def _velocities(
    annotations: Columns,
    time_ns: int,
    rows: NDArray[np.intp],
    pose_at: Callable[[int], Pose | None],
    world: Pose | None,
) -> list[tuple[float, float, float] | None]:
    """Return velocities of objects, vehicle's frame, from adjacent sweeps in the city frame.

    Args:
        annotations: annotations of the log.
        time_ns: time of the sweep.
        rows: rows of its boxes.
        pose_at: returns the vehicle's pose in the city frame.
        world: pose at the sweep.
    """
    times = annotations["timestamp_ns"]
    near = np.unique(times[np.abs(times - time_ns) < _APART_NS])
    begin, end = (
        int(one) for one in (near[near <= time_ns][-2:][0], near[near >= time_ns][:2][-1])
    )
    poses = {one: pose_at(one) for one in (begin, end)}
    first, last = poses[begin], poses[end]
    if begin == end or first is None or last is None or world is None:
        return [None] * len(rows)
    places = np.column_stack([annotations[side] for side in _PLACE]).astype(np.float64)
    where: list[dict[str, NDArray[np.float64]]] = []
    for one, pose in ((begin, first), (time_ns, world), (end, last)):
        mine = np.flatnonzero(times == one)
        there = pose.apply(places[mine])
        where.append(dict(zip(map(str, annotations["track_uuid"][mine]), there, strict=True)))
    found: list[tuple[float, float, float] | None] = []
    for track in map(str, annotations["track_uuid"][rows]):
        # Tracks that start or end here use half the interval.
        (since, old), (until, new) = (
            (one, place[track]) if track in place else (time_ns, where[1][track])
            for one, place in ((begin, where[0]), (end, where[2]))
        )
        if since == until:
            found.append(None)
        else:
            x, y, z = ((new - old) / (until - since) * 1e9) @ world.rotation
            found.append((float(x), float(y), float(z)))
    return found
