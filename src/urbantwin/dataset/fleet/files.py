"""The files of a fleet, read: its nodes, where each was and believed to be, its common labels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.box_columns import BOX_FIELDS
from urbantwin.dataset.fleet.manifest_schema import read_fleet_manifest
from urbantwin.dataset.frame_files import FrameFiles
from urbantwin.dataset.table_form import read_table
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

if TYPE_CHECKING:
    import pyarrow as pa

__all__ = ["FleetFiles", "NodeState"]

_POSE = ("x", "y", "z", "yaw", "pitch", "roll")
_POSES = ("true", "reported", "node")
_EXPECTED = "a fleet of urbantwin record --nodes"
_OF_BOXES = {
    **dict.fromkeys(("frame", "class"), "text"),
    **dict.fromkeys(("track", "num_points", "num_nodes"), "whole"),
    **dict.fromkeys(("time_s", *BOX_FIELDS, "vx", "vy", "vz"), "number"),
}
_OF_NODES = {
    **dict.fromkeys(("frame", "node"), "text"),
    "time_s": "number",
    "points": "whole",
}


@dataclass(frozen=True, eq=False)
class NodeState:
    """A node in a frame.

    Attributes:
        present: whether it was there: all else is ``None`` where it was not.
        points: how many it has.
        clock_s: what its clock said at the frame's time.
        sent_s: when its frame was complete, true time of the motion.
        lost: whether nobody else has it.
        arrival_s: when the others have it; ``None`` where it was lost.
        true: ``site_SE3_points``: takes its points to the site.
        reported: the same as it believes.
        place: ``site_SE3_node``: where its vehicle truly is, or its pole's first sensor, upright.
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
        """Where it believes itself to be: ``place`` as it reports it."""
        if self.true is None or self.reported is None or self.place is None:
            return None
        return self.reported @ self.true.inverse() @ self.place


class FleetFiles:
    """A fleet on disk; its tables and clouds are read when they are asked for.

    Args:
        folder: of the fleet.

    Attributes:
        folder: where it is.
        manifest: ``fleet.json``.
        names: of the nodes.
        frames: names of the frames, in the order of time.
        times_s: (F,) their times, seconds from the motion's start.

    Raises:
        InputError: it is no fleet.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest: dict[str, Any] = read_fleet_manifest(folder)
        self.names: tuple[str, ...] = tuple(one["name"] for one in self.manifest["nodes"])
        told = self.manifest["frames"]
        self.frames: tuple[str, ...] = tuple(one["name"] for one in told)
        self.times_s: NDArray[np.float64] = np.array([one["time_s"] for one in told], np.float64)
        self._of_nodes: dict[str, pa.Table] = {}

    def folder_of(self, node: str) -> Path:
        """Return the folder of a node's dataset.

        Raises:
            InputError: there is no such node.
        """
        if node not in self.names:
            raise InputError(
                f"has no node {node!r:.60}",
                file=self.folder,
                expected=f"one of {', '.join(self.names)}",
            )
        return self.folder / node

    @cached_property
    def boxes(self) -> pa.Table:
        """``boxes.parquet``: the common labels."""
        return _table(self.folder / "boxes.parquet", _OF_BOXES)

    @cached_property
    def nodes(self) -> pa.Table:
        """``nodes.parquet``: where and when every node was in every frame."""
        return _table(self.folder / "nodes.parquet", _OF_NODES)

    def boxes_of_node(self, node: str) -> pa.Table:
        """Return ``boxes.parquet`` of a node's dataset: its own labels, in its own frame.

        Raises:
            InputError: there is no such node.
        """
        if node not in self._of_nodes:
            self._of_nodes[node] = read_table(self.folder_of(node) / "boxes.parquet")
        return self._of_nodes[node]

    def boxes_of(self, frame: str) -> pa.Table:
        """Return the common labels of a frame."""
        first, last = self._rows.get(frame, (0, 0))
        return self.boxes.slice(first, last - first)

    def state(self, frame: str, node: str) -> NodeState:
        """Return where a node was in a frame, and when.

        Raises:
            InputError: there is no such node or frame.
        """
        self.folder_of(node)
        if (frame, node) not in self._states:
            raise InputError(
                f"has no row of {node} in frame {frame!r:.40}",
                file=self.folder / "nodes.parquet",
                expected=f"frames {self.frames[0]} to {self.frames[-1]}",
            )
        return self._states[frame, node]

    def cloud(self, frame: str, node: str) -> FrameFiles:
        """Return the points of a node in a frame, in its own frame of reference.

        Raises:
            InputError: there is no such node or frame, or it was not there.
        """
        if not self.state(frame, node).present:
            raise InputError(
                f"{node} is not there in frame {frame}",
                file=self.folder,
                expected="a frame in which nodes.parquet says that it is present",
            )
        return FrameFiles(self.folder_of(node), frame)

    @cached_property
    def _rows(self) -> dict[str, tuple[int, int]]:
        """The first row of the boxes of each frame, and the one after the last."""
        names = np.asarray(self.boxes["frame"].to_pylist(), object)
        cuts = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1).tolist(), len(names)]
        if len(names) == 0:
            return {}
        return {str(names[a]): (a, b) for a, b in pairwise(cuts)}

    @cached_property
    def _states(self) -> dict[tuple[str, str], NodeState]:
        found = {}
        for row in self.nodes.to_pylist():
            place = (str(row["frame"]), str(row["node"]))
            found[place] = _state(row, self.folder / "nodes.parquet")
        return found


def _state(row: dict[str, Any], file: Path) -> NodeState:
    if not row.get("present"):
        return NodeState(present=False)
    names = ["clock_s", "sent_s", *(f"{k}_{n}" for k in _POSES for n in _POSE)]
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
        Pose.from_ypr([values[f"{kind}_{name}"] for name in _POSE[:3]],
                      *(values[f"{kind}_{name}"] for name in _POSE[3:]))
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


def _table(path: Path, columns: dict[str, str]) -> pa.Table:
    """Read a table and check the columns that everybody relies on."""
    table = read_parquet(path, _EXPECTED)
    columns_of(table, columns, path, _EXPECTED)
    return table
