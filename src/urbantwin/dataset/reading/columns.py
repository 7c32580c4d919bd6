"""Columns of every table of a dataset and of a fleet, with their Arrow types.

A type with ``?`` marks an optional column: it may be missing, and rows may lack a value. Lengths
are in metres, angles in radians, times in seconds from the start of the motion, velocities in
metres per second.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = [
    "ANGLES",
    "BOX",
    "BOXES",
    "FLEET_BOXES",
    "FLEET_BOXES_OF_NODE",
    "LANES",
    "LANES_FILE",
    "NODES",
    "PLACE",
    "POINT",
    "POSE",
    "POSES",
    "SEQUENCE_TABLES",
    "SIZE",
    "SWEEPS",
    "TABLES",
    "TRAJECTORIES",
    "TRAJECTORIES_FILE",
    "VELOCITY",
    "arrow_schema",
]

PLACE = ("x", "y", "z")
ANGLES = ("yaw", "pitch", "roll")
SIZE = ("length", "width", "height")
VELOCITY = ("vx", "vy", "vz")
#: A pose: position and attitude.
POSE = (*PLACE, *ANGLES)
#: A box: centre, size, and heading from the x axis.
BOX = (*PLACE, *SIZE, "yaw")
#: A point: position, and intensity from 0 to 1.
POINT = (*PLACE, "intensity")

_TRUE_AND_REPORTED = {f"{kind}_{name}": "float64" for kind in ("true", "reported") for name in POSE}

#: One row per frame and box, in the frame of the points. The actor is in its box ``observed_s``
#: after the time of the frame, when the rays hit it. ``occlusion`` and ``visibility`` are null for
#: an actor that no ray reaches even without occlusion; one of ``difficulty`` and ``ignored`` is
#: null (``docs/reference/labels.md``). ``towed_by`` is the track of the towing actor, null for
#: most.
BOXES = {
    "frame": "string",
    "time_s": "float64",
    "track": "int32",
    "class": "string",
    **dict.fromkeys(BOX, "float64"),
    "num_points": "int32",
    "num_points_alone": "int32?",
    **dict.fromkeys(("occlusion", "visibility", "truncation"), "float64?"),
    **dict.fromkeys(("difficulty", "ignored"), "string?"),
    "observed_s": "float64",
    **dict.fromkeys(VELOCITY, "float64"),
    "parked": "bool_?",
    "towed_by": "int32?",
}
#: One row per frame, sensor and turn. Times are true, except ``clock_start_s``, the sensor's clock
#: at ``start_s``. Poses are ``site_SE3_sensor`` at ``start_s``: the true one, and the one with
#: which points are computed.
SWEEPS = {
    **dict.fromkeys(("frame", "sensor"), "string"),
    "turn": "int32",
    "start_s": "float64",
    "stop_s": "float64?",
    "clock_start_s": "float64",
    "arrival_s": "float64?",
    "lost": "bool_?",
    **_TRUE_AND_REPORTED,
}
#: One row per frame and vehicle that carries the sensors (for a fixed rig: the frame of the
#: points), and one per turn of a sensor: poses in the site at ``time_s``.
POSES = {
    **dict.fromkeys(("frame", "name"), "string"),
    "turn": "int32",
    "time_s": "float64",
    **_TRUE_AND_REPORTED,
}
#: One row per track and step of the motion: centre of the track's box and attitude of its body in
#: the site, speed along the heading, lane of the twin.
TRAJECTORIES = {
    "time_s": "float64",
    "track": "int32",
    "class": "string",
    **dict.fromkeys(POSE, "float64"),
    "speed": "float64?",
    "lane": "string?",
}
#: One row per lane of the twin; ``x``, ``y`` and ``z`` are its centre line from start to end in the
#: site, ``allowed`` the classes that may use it, ``successors`` the following lanes.
LANES = {
    **dict.fromkeys(("id", "road", "junction", "kind"), "string"),
    **dict.fromkeys(("width", "speed_limit"), "float64"),
    "level": "int32",
    **dict.fromkeys(("allowed", "successors"), "list of string?"),
    **dict.fromkeys(PLACE, "list of float64"),
}
_TRACKS = {
    **dict.fromkeys(("class", "first_frame", "last_frame"), "string"),
    "track": "int32",
}
_TRACKLETS = {
    **dict.fromkeys(("class", "frame"), "string"),
    **dict.fromkeys(("track", "num_points"), "int32"),
    **dict.fromkeys(("time_s", *POSE, *SIZE, *VELOCITY), "float64"),
    **{name: BOXES[name] for name in ("occlusion", "visibility", "truncation")},
    **{name: BOXES[name] for name in ("difficulty", "ignored")},
}
#: One row per frame and node of a fleet. Times are true, except ``clock_s``, the node's clock at
#: ``time_s``. Poses in the site: ``true_*`` and ``reported_*`` of the frame of its points;
#: ``node_*``, true pose of the vehicle, or of the first sensor of a pole, made upright.
NODES = {
    "frame": "string",
    "time_s": "float64",
    "node": "string",
    "present": "bool_?",
    "points": "int64",
    **dict.fromkeys(("clock_s", "sent_s"), "float64?"),
    "lost": "bool_?",
    "arrival_s": "float64?",
    **{f"{kind}_{name}": "float64?" for kind in ("true", "reported", "node") for name in POSE},
}
#: One row per frame and actor of a fleet, in the site, at ``time_s`` exactly.
FLEET_BOXES = {
    "frame": "string",
    "time_s": "float64",
    "track": "int32",
    "class": "string",
    **dict.fromkeys((*BOX, *VELOCITY), "float64"),
    **dict.fromkeys(("num_points", "num_nodes"), "int32"),
    **dict.fromkeys(("occlusion", "visibility"), "float64?"),
    **dict.fromkeys(("difficulty", "ignored"), "string?"),
    "parked": "bool_?",
    "towed_by": "int32?",
    "carries": "string?",
}
#: Columns of each node, named ``NAME.NODE``; null if the node is absent, or mounted on the actor.
FLEET_BOXES_OF_NODE = {
    **dict.fromkeys(("num_points", "num_points_alone"), "int32?"),
    **dict.fromkeys(("occlusion", "visibility", "truncation"), "float64?"),
    **dict.fromkeys(("difficulty", "ignored"), "string?"),
}

TRAJECTORIES_FILE = "trajectories.parquet"
LANES_FILE = "lanes.parquet"
#: Tables of actors and sensors over the frames.
SEQUENCE_TABLES = (
    "tracks.parquet", "tracklets.parquet", TRAJECTORIES_FILE, "poses.parquet", LANES_FILE
)  # fmt: skip
#: Columns of each table of a dataset, by file name.
TABLES: Mapping[str, Mapping[str, str]] = {
    "boxes.parquet": BOXES,
    "sweeps.parquet": SWEEPS,
    "tracks.parquet": _TRACKS,
    "tracklets.parquet": _TRACKLETS,
    TRAJECTORIES_FILE: TRAJECTORIES,
    "poses.parquet": POSES,
    LANES_FILE: LANES,
}


def arrow_schema(columns: Mapping[str, str]) -> pa.Schema:
    """Return the Arrow schema of the columns of a table."""
    import pyarrow as pa

    def kind(name: str) -> pa.DataType:
        inner = name.removeprefix("list of ")
        arrow_type = getattr(pa, inner)()
        return arrow_type if inner == name else pa.list_(arrow_type)

    return pa.schema(
        [(name, kind(column_type.removesuffix("?"))) for name, column_type in columns.items()]
    )
