"""``nodes.parquet``: time, pose and transmission of every node in every frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.fleet.node import Node
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.motion_interpolation import rows_at
from urbantwin.dataset.reading.columns import NODES, POSE, arrow_schema
from urbantwin.dataset.reading.manifest import pose_matrix, pose_of_matrix
from urbantwin.geometry import Pose, ypr_from_rotation
from urbantwin.site.nodes import PoseErrorSpec, PoseOffset, PoseSpread, RadioSpec

if TYPE_CHECKING:
    from urbantwin.traffic import Motion

__all__ = [
    "Purpose",
    "node_rows",
    "normal_draws",
    "pose_errors",
    "received",
    "reported_pose",
    "uniform_draws",
    "write_nodes",
]


#: Bit of the key that separates these draws from those of sensors, see `lidar.timing`.
_OF_NODES = 1 << 46
_WORDS = 8  # random words per frame


class Purpose(IntEnum):
    """Purpose of random numbers."""

    NOISE = 1
    WALK = 2
    RADIO = 3


def uniform_draws(seed: int, purpose: Purpose, frames: int) -> NDArray[np.float64]:
    """Return numbers (F, 8) in (0, 1) of frames 0, 1, 2, ...; independent of F.

    Args:
        seed: seed of the node.
        purpose: purpose of the numbers.
        frames: number of frames.
    """
    key = np.array([seed % 2**64, _OF_NODES | purpose], np.uint64)
    words = np.random.Philox(key=key).random_raw(frames * _WORDS).reshape(frames, _WORDS)
    return np.asarray(((words >> np.uint64(11)) + 0.5) * 2.0**-53, np.float64)


def normal_draws(seed: int, purpose: Purpose, frames: int) -> NDArray[np.float64]:
    """Return standard normal numbers (F, 8) of the frames; arguments as `uniform_draws`."""
    return np.asarray(ndtri(uniform_draws(seed, purpose, frames)), np.float64)


def pose_errors(
    spec: PoseErrorSpec, seed: int, numbers: Sequence[int], rate_hz: float
) -> NDArray[np.float64]:
    """Return the pose errors (F, 6) of a node: forward, left, up in metres, yaw, pitch, roll.

    Angles are in radians. A frame's error depends on its number only.

    Args:
        spec: size of the errors.
        seed: seed of the node.
        numbers: frame numbers, from 0; frame n is at ``n / rate_hz`` seconds.
        rate_hz: frames per second.
    """
    index = np.asarray(numbers, np.int64)
    time_s = index[:, None] / rate_hz
    error = _vector(spec.bias) + _vector(spec.drift) * time_s
    if not len(index):
        return error
    count = int(index.max()) + 1
    noise, walk = _vector(spec.noise), _vector(spec.walk)
    if noise.any():
        error = error + normal_draws(seed, Purpose.NOISE, count)[index, :6] * noise
    if walk.any():
        steps = normal_draws(seed, Purpose.WALK, count)[:, :6]
        steps[0] = 0.0  # it begins at the motion's start
        error = error + np.cumsum(steps, axis=0)[index] * walk / np.sqrt(rate_hz)
    return error


def reported_pose(site_SE3_node: Pose, error: NDArray[np.float64]) -> Pose:
    """Return the pose that a node reports.

    Args:
        site_SE3_node: true pose.
        error: (6,) a row of `pose_errors`.
    """
    yaw, pitch, roll = (float(angle) for angle in error[3:])
    return site_SE3_node @ Pose.from_ypr(error[:3], yaw, pitch, roll)


def _vector(spec: PoseOffset | PoseSpread) -> NDArray[np.float64]:
    angles = np.radians([spec.yaw_deg, spec.pitch_deg, spec.roll_deg])
    return np.array([spec.forward_m, spec.left_m, spec.up_m, *angles])


#: Largest jitter, in standard deviations.
_FARTHEST_JITTER = 4.0


class Received(NamedTuple):
    """Transmission of F frames.

    Attributes:
        lost: (F,) which never arrive.
        arrival_s: (F,) time of arrival, if not lost.
    """

    lost: NDArray[np.bool_]
    arrival_s: NDArray[np.float64]


def received(
    spec: RadioSpec, seed: int, numbers: Sequence[int], sent_s: NDArray[np.float64]
) -> Received:
    """Simulate the transmission of a node's frames.

    Args:
        spec: its radio.
        seed: seed of the node.
        numbers: frame numbers, from 0.
        sent_s: (F,) time of sending, true time of the motion.
    """
    from scipy.special import ndtri

    index = np.asarray(numbers, np.int64)
    draws = uniform_draws(seed, Purpose.RADIO, int(index.max(initial=-1)) + 1)[index]
    lost = draws[:, 0] < spec.loss
    for outage in spec.outages:
        until = np.inf if outage.stop_s is None else outage.stop_s
        lost |= (sent_s >= outage.start_s) & (sent_s < until)
    late = np.clip(ndtri(draws[:, 1]), -_FARTHEST_JITTER, _FARTHEST_JITTER) * spec.jitter_s
    return Received(lost, sent_s + np.maximum(spec.latency_s + late, 0.0))


def node_rows(
    node: Node, entries: Mapping[int, Mapping[str, Any]], motion: Motion
) -> dict[int, dict[str, Any]]:
    """Return the rows of a node by frame number, for the frames in which it is present.

    A frame is complete, and sent, when the last of its turns has arrived; a frame without a turn at
    the start of the next frame.

    Args:
        node: the node.
        entries: number of each of its frames -> its entry.
        motion: the motion.
    """
    numbers, times = list(node.times_s), np.array(list(node.times_s.values()))
    rate_hz = node.rig.rate_hz
    sent = np.array([
        max((sweep["arrival_s"] for sweep in entries[k]["sweeps"] if not sweep["lost"]),
            default=time_s + 1.0 / rate_hz)
        for k, time_s in node.times_s.items()
    ])  # fmt: skip
    radio = received(node.spec.radio, node.seed, numbers, sent)
    errors = pose_errors(node.spec.pose_error, node.seed, numbers, rate_hz)
    clock = node.spec.clock
    rows = {}
    for n, index in enumerate(numbers):
        time_s = float(times[n])
        site_SE3_points = _points(node, entries[index])
        site_SE3_node = _place(node, time_s, motion)
        poses = {"true": site_SE3_points, "reported": site_SE3_points, "node": site_SE3_node}
        if errors[n].any():
            node_SE3_points = site_SE3_node.inverse() @ site_SE3_points
            poses["reported"] = reported_pose(site_SE3_node, errors[n]) @ node_SE3_points
        lost = bool(radio.lost[n])
        rows[index] = {
            "present": True,
            "points": int(entries[index]["points"]),
            "clock_s": time_s + clock.offset_s + clock.drift_ppm * 1e-6 * time_s,
            "sent_s": float(sent[n]),
            "lost": lost,
            "arrival_s": None if lost else float(radio.arrival_s[n]),
            **{
                f"{kind}_{name}": float(value) + 0.0
                for kind, pose in poses.items()
                for name, value in zip(
                    POSE, (*pose.translation, *ypr_from_rotation(pose.rotation)), strict=True
                )
            },
        }
    return rows


def write_nodes(
    path: Path,
    times_s: Mapping[int, float],
    nodes: Sequence[Node],
    rows: Mapping[str, Mapping[int, Mapping[str, Any]]],
) -> None:
    """Write the table.

    Args:
        path: the file.
        times_s: frame number -> time, of the run.
        nodes: all nodes.
        rows: name of each node -> its `node_rows`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    absent = {"present": False, "points": 0, "lost": False}
    table_rows = [
        {
            "frame": frame_name(index),
            "time_s": time_s,
            "node": node.name,
            **rows[node.name].get(index, absent),
        }
        for index, time_s in times_s.items()
        for node in nodes
    ]
    pq.write_table(pa.Table.from_pylist(table_rows, schema=arrow_schema(NODES)), path, **PARQUET)


def _points(node: Node, entry: Mapping[str, Any]) -> Pose:
    """Return the pose of the points of a frame in the site."""
    rows = entry.get("dataset_SE3_site") or pose_matrix(node.rig.dataset_SE3_site)
    return pose_of_matrix(rows).inverse()


def _place(node: Node, time_s: float, motion: Motion) -> Pose:
    """Return the pose of a node: of its carrier, or upright at its first sensor."""
    if node.rig.carrier is None:
        return node.site_SE3_standing
    rows = rows_at(motion, time_s)
    (row,) = rows[rows["track"] == node.rig.carrier]
    place = np.array([row["x"], row["y"], row["z"]], np.float64)
    return Pose.from_ypr(place, float(row["yaw"]), float(row["pitch"]), float(row["roll"]))
