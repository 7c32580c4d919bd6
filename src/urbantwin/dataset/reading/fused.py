"""Point clouds of several nodes in one frame: true, or as one node receives them."""

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

#: Poses and times that are used: true, or reported by the nodes.
Knowledge = Literal["true", "reported"]
#: Frame of the other nodes, see `fused_cloud`.
Alignment = Literal["same", "nearest", "extrapolated"]


@dataclass(frozen=True, eq=False)
class FusedCloud:
    """N points of several nodes.

    Attributes:
        points: (N, 4) float32: x, y, z in metres, in the frame of one node's points or of the site,
            and intensity 0..1.
        labels: (N,) uint32: class in the low 16 bits, track in the high.
        node: (N,) uint8: index of the node in ``nodes``.
        nodes: names of all requested nodes.
        frames: name of each node -> its frame that is included; ``None`` for none.
        age_s: name of each included node -> age of its cloud relative to the frame, by the times
            used.
    """

    points: NDArray[np.float32]
    labels: NDArray[np.uint32]
    node: NDArray[np.uint8]
    nodes: tuple[str, ...]
    frames: Mapping[str, str | None]
    age_s: Mapping[str, float]

    @property
    def semantic(self) -> NDArray[np.uint16]:
        """Class id (N,) of each point."""
        return (self.labels & 0xFFFF).astype(np.uint16)

    @property
    def instance(self) -> NDArray[np.uint16]:
        """Track (N,) of the actor of each point; 0 for the static world."""
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
        frame_of: receiving node, whose frame is used; ``None``: the site, which receives all.
        using: ``reported`` or ``true`` poses and times.
        at: ``same``: the frame of that name of all nodes, even if lost. ``nearest``: of the frames
            that had arrived when the receiver's own was complete, the nearest in time.
            ``extrapolated``: the same, with points on actors moved at the actor's labelled velocity
            over the age of the frame.
        nodes: names of the nodes; all if not given.

    Raises:
        InputError: no such frame or node, or the receiver is not present in that frame.
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
        raise InputError("no receiver is given", place="frame_of", expected="a node, or at: same")
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
        if at == "extrapolated" and name != frame_of:  # with errors of the clocks
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
    """Return the time of a node's frame, true or by its own clock."""
    if using == "true":
        return float(fleet.times_s[fleet.names.index(frame)])
    assert state.clock_s is not None
    return state.clock_s


def _nearest(
    fleet: Fleet, name: str, frame: str, receiver: NodeState, using: Knowledge
) -> str | None:
    """Return the nearest frame in time of a node among those that have arrived."""
    assert receiver.sent_s is not None
    wanted_s = _time(fleet, frame, receiver, using)
    best, least = None, np.inf
    for candidate in fleet.names:
        state = fleet.state(candidate, name)
        if state.arrival_s is None or state.arrival_s > receiver.sent_s:
            continue
        apart = abs(_time(fleet, candidate, state, using) - wanted_s)
        if apart <= least:  # of equals the later
            best, least = candidate, apart
    return best


def _velocities(
    fleet: Fleet, node: str, frame: str, labels: NDArray[np.uint32]
) -> NDArray[np.float64]:
    """Return the labelled velocity of the actor under each point (N, 3), in the node's frame."""
    table = fleet.nodes[node].boxes
    in_frame = np.flatnonzero(np.asarray(table["frame"].to_pylist(), object) == frame)
    rows = table.take(in_frame)
    tracks = rows["track"].to_numpy()
    speed = np.column_stack([rows[axis].to_numpy() for axis in VELOCITY])
    track = labels >> 16
    velocity_of_point = np.zeros((len(track), 3))
    for number, velocity in zip(tracks.tolist(), speed, strict=True):
        velocity_of_point[track == number] = velocity
    return velocity_of_point
