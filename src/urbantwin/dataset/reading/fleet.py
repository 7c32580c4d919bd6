"""A fleet on disk: fixed and mounted nodes, recorded together from one motion."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.columns import FLEET_BOXES, NODES, POSE
from urbantwin.dataset.reading.dataset import Dataset
from urbantwin.dataset.reading.frame import Frame
from urbantwin.dataset.reading.frame_files import FrameFiles
from urbantwin.dataset.reading.fused import Alignment, FusedCloud, Knowledge, fused_cloud
from urbantwin.dataset.reading.manifest import read_fleet_manifest
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.dataset.reading.tables import box_array, read_table
from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.result_warning import ResultWarning, warnings_of

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["Fleet", "FleetFrame", "NodeFrame", "NodeState"]

NODES_FILE = "nodes.parquet"
_POSES = ("true", "reported", "node")
_EXPECTED = "a fleet of urbantwin record --nodes"


@dataclass(frozen=True, eq=False)
class NodeState:
    """State of a node in a frame.

    Attributes:
        present: whether it was present; if not, all else is ``None``.
        points: number of points.
        clock_s: its clock at the frame's time.
        sent_s: time at which its frame was complete, true time of the motion.
        lost: whether its frame was lost in transmission.
        arrival_s: time at which other nodes have it; ``None`` if it was lost.
        true: ``site_SE3_points``: true pose of the frame of its points.
        reported: the same pose as the node reports it.
        place: ``site_SE3_node``: true pose of its vehicle, or of its pole's first sensor, made
            upright.
    """

    present: bool
    points: int = 0
    clock_s: float | None = None
    sent_s: float | None = None
    lost: bool = False
    arrival_s: float | None = None
    true: Pose | None = None
    reported: Pose | None = None
    place: Pose | None = None

    @property
    def believed(self) -> Pose | None:
        """Pose ``place`` as the node reports it."""
        if self.true is None or self.reported is None or self.place is None:
            return None
        return self.reported @ self.true.inverse() @ self.place


@dataclass(frozen=True, eq=False)
class NodeFrame:
    """One node in one frame.

    Attributes:
        node: name of the node.
        dataset: dataset of the node.
        name: name of the frame.
        state: pose, clock and transmission.

    Example:
        >>> bus = fleet.frame(3).node("bus")
        >>> bus.reported.apply(bus.points[:, :3])  # in the site frame, by its reported pose
    """

    node: str
    dataset: Dataset
    name: str
    state: NodeState

    @property
    def present(self) -> bool:
        """Whether it was present; if not, it has no data."""
        return self.state.present

    @property
    def lost(self) -> bool:
        """Whether its frame was lost in transmission."""
        return self.state.lost

    @property
    def clock_s(self) -> float | None:
        """Its clock at the frame's time: the time stamp of the frame."""
        return self.state.clock_s

    @property
    def arrival_s(self) -> float | None:
        """Time at which other nodes have its frame, true; ``None`` if it was lost."""
        return self.state.arrival_s

    @property
    def true(self) -> Pose | None:
        """``site_SE3_points``: true pose of the frame of its points."""
        return self.state.true

    @property
    def reported(self) -> Pose | None:
        """The same pose as the node reports it."""
        return self.state.reported

    @property
    def place(self) -> Pose | None:
        """``site_SE3_node``: true pose of its vehicle, or of its pole's first sensor, upright."""
        return self.state.place

    @cached_property
    def frame(self) -> Frame:
        """The frame in its own dataset, with its own labels.

        Raises:
            InputError: it was not present.
        """
        if not self.present:
            raise InputError(
                f"{self.node} is not there in frame {self.name}",
                file=self.dataset.folder,
                expected="a frame in which it is present",
            )
        return self.dataset[self.dataset.names.index(self.name)]

    @property
    def points(self) -> NDArray[np.float32]:
        """Points (N, 4): x, y, z in metres, in the node's frame, and intensity 0..1."""
        return self.frame.points

    @property
    def boxes(self) -> pa.Table:
        """Its own labels, in its own frame."""
        return self.frame.boxes


@dataclass(frozen=True, eq=False)
class FleetFrame:
    """One frame of a fleet.

    Attributes:
        fleet: the fleet.
        name: name of the frame in every node's dataset.
        time_s: seconds from the start of the motion.
    """

    fleet: Fleet
    name: str
    time_s: float

    def node(self, name: str) -> NodeFrame:
        """Return a node in this frame.

        Raises:
            InputError: no such node.
        """
        state = self.fleet.state(self.name, name)
        return NodeFrame(name, self.fleet.nodes[name], self.name, state)

    @property
    def nodes(self) -> dict[str, NodeFrame]:
        """All present nodes, by name."""
        all_nodes = {name: self.node(name) for name in self.fleet.nodes}
        return {name: node for name, node in all_nodes.items() if node.present}

    @cached_property
    def boxes(self) -> pa.Table:
        """The common labels, in the site: rows of `Fleet.boxes`."""
        return self.fleet.boxes_of(self.name)

    @cached_property
    def box_array(self) -> NDArray[np.float64]:
        """Boxes (B, 7) in the site: centre x, y, z, length, width, height in metres, yaw."""
        return box_array(self.boxes)

    def fused(
        self,
        frame_of: str | None = None,
        using: Knowledge = "reported",
        at: Alignment = "same",
        nodes: Sequence[str] | None = None,
    ) -> FusedCloud:
        """Return the points of all nodes in one frame of reference; see `fused_cloud`.

        Args:
            frame_of: receiving node, whose frame is used; the site if not given.
            using: ``reported`` or ``true`` poses and times.
            at: ``same``, ``nearest`` or ``extrapolated`` frames of the other nodes.
            nodes: names of the nodes; all if not given.

        Raises:
            InputError: no such node, or the receiver is not present.
        """
        return fused_cloud(
            self.fleet, self.name, frame_of=frame_of, using=using, at=at, nodes=nodes
        )

    def __repr__(self) -> str:
        """Return name, time and present nodes."""
        return f"FleetFrame {self.name} at {self.time_s:g} s: {', '.join(self.nodes)}"


class Fleet(Sequence[FleetFrame]):
    """Several nodes on disk; `urbantwin.Fleet` adds a summary and pictures.

    Attributes:
        folder: its folder.
        manifest: content of ``fleet.json``.
        node_names: names of the nodes.
        names: names of the frames, in order of time.
        times_s: (F,) times of the frames, seconds from the motion's start.

    Raises:
        InputError: not a fleet.
    """

    #: Class of the nodes' datasets.
    dataset_type: ClassVar[type[Dataset]] = Dataset

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder)
        self.manifest: dict[str, Any] = read_fleet_manifest(self.folder)
        self.node_names: tuple[str, ...] = tuple(entry["name"] for entry in self.manifest["nodes"])
        frames = self.manifest["frames"]
        self.names: tuple[str, ...] = tuple(entry["name"] for entry in frames)
        self.times_s: NDArray[np.float64] = np.array(
            [entry["time_s"] for entry in frames], np.float64
        )

    @classmethod
    def open(cls, folder: str | os.PathLike[str]) -> Self:
        """Open a fleet's folder.

        Raises:
            InputError: not a fleet, or its manifest is damaged.
        """
        return cls(folder)

    @cached_property
    def nodes(self) -> dict[str, Dataset]:
        """Dataset of each node by name."""
        return {name: self.dataset_type(self.folder / name) for name in self.node_names}

    @cached_property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``: one row per frame and actor, in the site; see docs/howto/nodes.md."""
        return read_table(self.folder / "boxes.parquet", FLEET_BOXES)

    @cached_property
    def objects(self) -> LabelledObjects:
        """The rows of `boxes` as arrays."""
        return LabelledObjects.of_table(self.boxes, self.folder)

    @cached_property
    def states(self) -> pa.Table:
        """``nodes.parquet``: one row per frame and node: poses, clock, radio."""
        return read_table(self.folder / NODES_FILE, NODES)

    def boxes_of(self, frame: str) -> pa.Table:
        """Return the common labels of a frame."""
        return self.boxes.take(self.objects.rows_of(frame))

    def folder_of(self, node: str) -> Path:
        """Return the folder of a node's dataset.

        Raises:
            InputError: no such node.
        """
        if node not in self.node_names:
            raise InputError(
                f"has no node {node!r:.60}",
                file=self.folder,
                expected=f"one of {', '.join(self.node_names)}",
            )
        return self.folder / node

    def state(self, frame: str, node: str) -> NodeState:
        """Return the state of a node in a frame.

        Raises:
            InputError: no such node or frame.
        """
        self.folder_of(node)
        if (frame, node) not in self._states:
            raise InputError(
                f"has no row of {node} in frame {frame!r:.40}",
                file=self.folder / NODES_FILE,
                expected=f"frames {self.names[0]} to {self.names[-1]}",
            )
        return self._states[frame, node]

    def cloud(self, frame: str, node: str) -> FrameFiles:
        """Return the points of a node in a frame, in its own frame of reference.

        Raises:
            InputError: no such node or frame, or the node is not present.
        """
        if not self.state(frame, node).present:
            raise InputError(
                f"{node} is not there in frame {frame}",
                file=self.folder,
                expected="a frame in which nodes.parquet says that it is present",
            )
        return FrameFiles(self.folder_of(node), frame)

    @cached_property
    def _states(self) -> dict[tuple[str, str], NodeState]:
        file = self.folder / NODES_FILE
        rows = self.states.to_pylist()
        return {(str(row["frame"]), str(row["node"])): _state(row, file) for row in rows}

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """Warnings of the fleet, and of the dataset of each node."""
        warnings = list(warnings_of(self.manifest))
        of_nodes = [
            (name, warning) for name, dataset in self.nodes.items() for warning in dataset.warnings
        ]
        for name, warning in of_nodes:
            if sum(warning == other for _, other in of_nodes) == len(
                self.nodes
            ):  # common to all nodes: once
                warnings += [warning] if warning not in warnings else []
            else:
                about = f"{name}: {warning.about}"
                warnings.append(
                    ResultWarning(about, warning.problem, warning.reason, warning.remedy)
                )
        return tuple(warnings)

    def frame(self, frame: int | str) -> FleetFrame:
        """Return a frame by index or name.

        Raises:
            InputError: no such frame.
        """
        if isinstance(frame, str):
            if frame not in self.names:
                raise InputError(
                    f"has no frame {frame!r:.40}",
                    file=self.folder,
                    expected=f"{self.names[0]} to {self.names[-1]}",
                )
            frame = self.names.index(frame)
        try:
            return self[frame]
        except IndexError:
            raise InputError(
                f"has no frame {frame}", file=self.folder, expected=f"0 to {len(self) - 1}"
            ) from None

    def __getitem__(self, frame: int) -> FleetFrame:  # type: ignore[override]
        """Return a frame by index."""
        return FleetFrame(self, self.names[frame], float(self.times_s[frame]))

    def __iter__(self) -> Iterator[FleetFrame]:
        """Return the frames in order of time."""
        return (self[number] for number in range(len(self)))

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.names)

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return nodes, frames and folder."""
        return (
            f"Fleet of {', '.join(self.node_names)}: {len(self)} frames from "
            f"{self.times_s[0]:g} to {self.times_s[-1]:g} s ({self.folder})"
        )


def _state(row: dict[str, Any], file: Path) -> NodeState:
    if not row.get("present"):
        return NodeState(present=False)
    names = ["clock_s", "sent_s", *(f"{k}_{n}" for k in _POSES for n in POSE)]
    values: dict[str, Any] = {name: row.get(name) for name in names}
    late = None if row.get("lost") else row.get("arrival_s", np.nan)
    missing = [name for name, value in values.items() if not _is_number(value)]
    missing += ["arrival_s"] if late is not None and not _is_number(late) else []
    if missing:
        raise InputError(
            f"has no number for {row['node']} in frame {row['frame']}",
            file=file,
            place=missing[0],
            expected=_EXPECTED,
        )
    true, reported, place = (
        Pose.from_ypr([values[f"{kind}_{name}"] for name in POSE[:3]],
                      *(values[f"{kind}_{name}"] for name in POSE[3:]))
        for kind in _POSES
    )  # fmt: skip
    return NodeState(
        present=True,
        points=int(row["points"]),
        clock_s=values["clock_s"],
        sent_s=values["sent_s"],
        lost=bool(row.get("lost")),
        arrival_s=late,
        true=true,
        reported=reported,
        place=place,
    )


def _is_number(value: object) -> bool:
    return isinstance(value, float) and bool(np.isfinite(value))
