"""A fleet: nodes that stand and nodes that ride, recorded together from one motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.fleet import FleetFiles, NodeState
from urbantwin.errors import InputError
from urbantwin.interface.dataset import Dataset, Frame
from urbantwin.interface.place import AnyPath
from urbantwin.interface.summary import Summary
from urbantwin.result_warning import ResultWarning, warnings_of

if TYPE_CHECKING:
    import pyarrow as pa
    from matplotlib.figure import Figure

    from urbantwin.dataset.fleet.fused import Alignment, FusedCloud, Knowledge
    from urbantwin.geometry import Pose

__all__ = ["Fleet", "FleetFrame", "NodeFrame"]

_BOX = ("x", "y", "z", "length", "width", "height", "yaw")


@dataclass(frozen=True, eq=False)
class NodeFrame:
    """What one node has of a frame.

    Attributes:
        node: its name.
        dataset: of the node.
        name: of the frame.
        state: where and when it was, and whether the others have its frame.

    Example:
        >>> bus = fleet.frame(3).node("bus")
        >>> bus.reported.apply(bus.points[:, :3])  # in the site, as it believes
    """

    node: str
    dataset: Dataset
    name: str
    state: NodeState

    @property
    def present(self) -> bool:
        """Whether it was there; without it, there is nothing else."""
        return self.state.present

    @property
    def lost(self) -> bool:
        """Whether its frame was lost on its way to the others."""
        return self.state.lost

    @property
    def clock_s(self) -> float | None:
        """What its own clock said at the frame's time: the stamp of the frame."""
        return self.state.clock_s

    @property
    def arrival_s(self) -> float | None:
        """When the others have its frame, true time of the motion; ``None`` where it is lost."""
        return self.state.arrival_s

    @property
    def true(self) -> Pose | None:
        """``site_SE3_points``: takes its points to the site."""
        return self.state.true

    @property
    def reported(self) -> Pose | None:
        """The same as the node believes."""
        return self.state.reported

    @property
    def place(self) -> Pose | None:
        """``site_SE3_node``: where its vehicle truly is, or its pole's first sensor, upright."""
        return self.state.place

    @cached_property
    def frame(self) -> Frame:
        """The frame of its own dataset, with its own labels.

        Raises:
            InputError: it was not there.
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
        fleet: that it is of.
        name: of the frame, in every node's dataset.
        time_s: seconds from the start of the motion.
    """

    fleet: Fleet
    name: str
    time_s: float

    def node(self, name: str) -> NodeFrame:
        """Return what a node has of it.

        Raises:
            InputError: there is no such node.
        """
        state = self.fleet.files.state(self.name, name)
        return NodeFrame(name, self.fleet.nodes[name], self.name, state)

    @property
    def nodes(self) -> dict[str, NodeFrame]:
        """All nodes that are there, by name."""
        every = {name: self.node(name) for name in self.fleet.nodes}
        return {name: one for name, one in every.items() if one.present}

    @cached_property
    def boxes(self) -> pa.Table:
        """The common labels, in the site: rows of `Fleet.boxes`."""
        return self.fleet.files.boxes_of(self.name)

    @cached_property
    def box_array(self) -> NDArray[np.float64]:
        """Boxes (B, 7) in the site: centre x, y, z, length, width, height in metres, yaw."""
        return np.column_stack([self.boxes[name].to_numpy() for name in _BOX]).reshape(-1, 7)

    def fused(
        self,
        frame_of: str | None = None,
        using: Knowledge = "reported",
        at: Alignment = "same",
        nodes: Sequence[str] | None = None,
    ) -> FusedCloud:
        """Return the points of all nodes in one frame of reference.

        Args:
            frame_of: the node in whose frame they are to be and which receives those of the
                others; the site if not given.
            using: poses and times as nodes have ``reported`` them, or the ``true`` ones.
            at: ``same``: everybody's frame of that name. ``nearest``: of those that had arrived
                when the receiver's own was complete, the one nearest in time. ``extrapolated``:
                the same, and points on actors go on as the actor's label moves.
            nodes: names of some nodes; all if not given.

        Raises:
            InputError: there is no such node, or the receiver is not there.
        """
        from urbantwin.dataset.fleet import fused_cloud

        return fused_cloud(
            self.fleet.files, self.name, frame_of=frame_of, using=using, at=at, nodes=nodes
        )

    def __repr__(self) -> str:
        """Return name, time and who is there."""
        return f"FleetFrame {self.name} at {self.time_s:g} s: {', '.join(self.nodes)}"


class Fleet(Sequence[FleetFrame]):
    """Several nodes on disk: a dataset for each, common labels, and where each was when.

    It stands for its folder wherever a path is asked for.

    Attributes:
        folder: where it is.
        files: its files.

    Example:
        >>> fleet = ut.record(twin, motion, nodes="nodes.yaml")
        >>> fleet.nodes["bus"][0].points, fleet.frame(0).boxes
        >>> fleet.frame(12).fused(frame_of="pole", using="reported").points
    """

    def __init__(self, folder: AnyPath) -> None:
        self.folder = Path(folder)
        self.files = FleetFiles(self.folder)

    @classmethod
    def open(cls, folder: AnyPath) -> Fleet:
        """Open a fleet's folder.

        Raises:
            InputError: it is not a fleet, or its manifest is damaged.
        """
        return cls(folder)

    @property
    def manifest(self) -> dict[str, Any]:
        """What ``fleet.json`` holds."""
        return self.files.manifest

    @cached_property
    def nodes(self) -> dict[str, Dataset]:
        """The dataset of each node by its name."""
        return {name: Dataset(self.files.folder_of(name)) for name in self.files.names}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the frames."""
        return self.files.frames

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (F,) of the frames, seconds from the start of the motion."""
        return self.files.times_s

    @property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``: one row for each frame and actor, in the site; see docs/nodes.md."""
        return self.files.boxes

    @property
    def states(self) -> pa.Table:
        """``nodes.parquet``: one row for each frame and node: poses, clock, radio."""
        return self.files.nodes

    @property
    def warnings(self) -> tuple[ResultWarning, ...]:
        """What is wrong with it, and with the dataset of each node."""
        found = list(warnings_of(self.manifest))
        of_nodes = [(name, one) for name, dataset in self.nodes.items() for one in dataset.warnings]
        for name, one in of_nodes:
            if sum(one == other for _, other in of_nodes) == len(self.nodes):  # of all: once
                found += [one] if one not in found else []
            else:
                about = f"{name}: {one.about}"
                found.append(ResultWarning(about, one.problem, one.reason, one.remedy))
        return tuple(found)

    def frame(self, frame: int | str) -> FleetFrame:
        """Return a frame by its place in the order of time, or by its name.

        Raises:
            InputError: there is no such frame.
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

    def plot(self, frame: int | str | None = None) -> Figure:
        """Draw a frame from above: the points of each node, and who is seen by whom.

        Args:
            frame: its number or its name; the one in which several nodes see most if not given.

        Raises:
            InputError: there is no such frame.
        """
        from urbantwin.view.fleet import figure_of_fleet
        from urbantwin.view.pictures import attributions

        name = None if frame is None else self.frame(frame).name
        return figure_of_fleet(self.files, name, attributions(self.manifest))

    def __getitem__(self, frame: int) -> FleetFrame:  # type: ignore[override]
        """Return the frame of a number."""
        return FleetFrame(self, self.names[frame], float(self.times_s[frame]))

    def __iter__(self) -> Iterator[FleetFrame]:
        """Return the frames in the order of time."""
        return (self[number] for number in range(len(self)))

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.names)

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

    def __repr__(self) -> str:
        """Return nodes, frames and folder."""
        return (
            f"Fleet of {', '.join(self.files.names)}: {len(self)} frames from "
            f"{self.times_s[0]:g} to {self.times_s[-1]:g} s ({self.folder})"
        )

    def summary(self) -> Summary:
        """Return what the fleet holds in a few values."""
        told = self.manifest
        boxes = self.boxes
        seen = boxes["num_nodes"].to_numpy()
        return Summary(
            path=str(self.folder),
            kind="fleet",
            made_with=f"urbantwin {told['urbantwin']}",
            frames=len(self),
            time_s=f"{self.times_s[0]:g} to {self.times_s[-1]:g}",
            rate_hz=told["rate_hz"],
            nodes={
                one["name"]: {
                    "rides": one["carrier"] if one["rides"] else None,
                    "sensors": [f"{row['name']} ({row['model']})" for row in one["sensors"]],
                    "frames": one["frames"],
                    "absent": one["frames_absent"],
                    "lost": one["frames_lost"],
                    "points": one["points"],
                }
                for one in told["nodes"]
            },
            boxes=len(seen),
            boxes_seen_by_one=int((seen == 1).sum()),
            boxes_seen_by_more=int((seen > 1).sum()),
            warnings=[str(one) for one in self.warnings],
        )
