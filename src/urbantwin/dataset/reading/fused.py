"""Clouds of all nodes in the frame of one: as they were, or as that node can know them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.columns import VELOCITY
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

if TYPE_CHECKING:
    from urbantwin.dataset.reading.fleet import Fleet, NodeState

__all__ = ["Alignment", "FusedCloud", "Knowledge", "fused_cloud"]

#: What is used of poses and times: as they were, or as nodes report them.
Knowledge = Literal["true", "reported"]
#: Which frame of another node is taken, see `fused_cloud`.
Alignment = Literal["same", "nearest", "extrapolated"]


@dataclass(frozen=True, eq=False)
class FusedCloud:
    """N points of several nodes.

    Attributes:
        points: (N, 4) float32: x, y, z in metres, in the frame of one node's points or of the
            site, and intensity 0..1.
        labels: (N,) uint32: class in the low 16 bits, track in the high.
        node: (N,) uint8: number of the node in ``nodes``.
        nodes: names of all nodes that were asked for.
        frames: name of each node -> the frame of it that is in; ``None``: none is.
        age_s: name of each node that is in -> how much older than the frame its cloud is, by the
            times that were used.
    """

    points: NDArray[np.float32]
    labels: NDArray[np.uint32]
    node: NDArray[np.uint8]
    nodes: tuple[str, ...]
    frames: Mapping[str, str | None]
    age_s: Mapping[str, float]

    @property
    def semantic(self) -> NDArray[np.uint16]:
        """Number (N,) of each point's class."""
        return (self.labels & 0xFFFF).astype(np.uint16)

    @property
    def instance(self) -> NDArray[np.uint16]:
        """Track (N,) of the actor that each point is on; 0 for the static world."""
        return (self.labels >> 16).astype(np.uint16)


def fused_cloud(
    fleet: Fleet,
    frame: str,
    *,
    frame_of: str | None = None,
    using: Knowledge = "reported",
    at: Alignment = "same",
    nodes: Sequence[str] | None = None,
) -> FusedCloud:
    """Return the points of several nodes in one frame of reference.

    Args:
        fleet: the fleet.
        frame: name of the frame.
        frame_of: the node in whose frame the points are to be, and which receives those of the
            others; ``None``: the site, where all is received.
        using: poses and times as nodes report them, or as they were.
        at: ``same``: everybody's frame of that name, also where it was lost on the air.
            ``nearest``: of the frames that had arrived when the receiver's own was complete, the
            one whose time is nearest to that of its own; none of who has sent none.
            ``extrapolated``: the same, and points on actors go on with the actor's labelled
            velocity for as long as they are old.
        nodes: which ones; all if not given.

    Raises:
        InputError: there is no such frame or node, or the receiver is not there in that frame.
    """
    for value, kind, place in ((using, Knowledge, "using"), (at, Alignment, "at")):
        if value not in get_args(kind):
            expected = ", ".join(get_args(kind))
            raise InputError(f"is {value!r:.40}", place=place, expected=expected)
    wanted = fleet.node_names if nodes is None else tuple(nodes)
    if frame not in fleet.names:
        raise InputError(
            f"has no frame {frame!r:.40}",
            file=fleet.folder,
            expected=f"{fleet.names[0]} to {fleet.names[-1]}",
        )
    receiver, own = None, Pose.from_ypr(np.zeros(3))
    if frame_of is not None:
        receiver = fleet.state(frame, frame_of)
        if not receiver.present:
            raise InputError(
                f"{frame_of} is not there in frame {frame}",
                file=fleet.folder,
                place="frame_of",
                expected="a node that is present",
            )
        own = _pose(receiver, using)
    elif at != "same":
        raise InputError("nobody receives", place="frame_of", expected="a node, or at: same")
    clouds, labels, numbers = [], [], []
    frames: dict[str, str | None] = {}
    age_s: dict[str, float] = {}
    for number, name in enumerate(wanted):
        taken: str | None = frame
        if at != "same" and receiver is not None and name != frame_of:
            taken = _nearest(fleet, name, frame, receiver, using)
        state = None if taken is None else fleet.state(taken, name)
        frames[name] = None
        if taken is None or state is None or not state.present:
            continue
        frames[name] = taken
        files = fleet.cloud(taken, name)
        age_s[name] = (
            0.0 if receiver is None else
            _time(fleet, frame, receiver, using) - _time(fleet, taken, state, using)
        )  # fmt: skip
        xyz = files.points[:, :3].astype(np.float64)
        if at == "extrapolated" and name != frame_of:  # by wrong clocks, wrongly
            xyz += _velocities(fleet, name, taken, files.labels) * age_s[name]
        if name != frame_of:
            xyz = (own.inverse() @ _pose(state, using)).apply(xyz)
        clouds.append(np.column_stack([xyz, files.points[:, 3]]).astype(np.float32))
        labels.append(files.labels)
        numbers.append(np.full(len(xyz), number, np.uint8))
    return FusedCloud(
        np.concatenate([np.zeros((0, 4), np.float32), *clouds]),
        np.concatenate([np.zeros(0, np.uint32), *labels]),
        np.concatenate([np.zeros(0, np.uint8), *numbers]),
        wanted,
        frames,
        age_s,
    )


def _pose(state: NodeState, using: Knowledge) -> Pose:
    pose = state.true if using == "true" else state.reported
    assert pose is not None
    return pose


def _time(fleet: Fleet, frame: str, state: NodeState, using: Knowledge) -> float:
    """Return the time of a node's frame, by its own clock or as it was."""
    if using == "true":
        return float(fleet.times_s[fleet.names.index(frame)])
    assert state.clock_s is not None
    return state.clock_s


def _nearest(
    fleet: Fleet, name: str, frame: str, receiver: NodeState, using: Knowledge
) -> str | None:
    """Return the frame of a node that is nearest in time, of those that have arrived."""
    assert receiver.sent_s is not None
    wanted_s = _time(fleet, frame, receiver, using)
    best, least = None, np.inf
    for one in fleet.names:
        state = fleet.state(one, name)
        if state.arrival_s is None or state.arrival_s > receiver.sent_s:
            continue
        apart = abs(_time(fleet, one, state, using) - wanted_s)
        if apart <= least:  # of two, the later
            best, least = one, apart
    return best


def _velocities(
    fleet: Fleet, node: str, frame: str, labels: NDArray[np.uint32]
) -> NDArray[np.float64]:
    """Return how the actor under each point (N, 3) moves, by the node's labels, in its frame."""
    table = fleet.nodes[node].boxes
    mine = np.flatnonzero(np.asarray(table["frame"].to_pylist(), object) == frame)
    rows = table.take(mine)
    tracks = rows["track"].to_numpy()
    speed = np.column_stack([rows[axis].to_numpy() for axis in VELOCITY])
    track = labels >> 16
    found = np.zeros((len(track), 3))
    for number, velocity in zip(tracks.tolist(), speed, strict=True):
        found[track == number] = velocity
    return found
