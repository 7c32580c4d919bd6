"""Nodes of a fusion study: times and poses of their frames, and the common labels.

They come from a fleet (``urbantwin record --nodes``), or from datasets of one motion: one per node,
or the datasets of each sensor written by ``urbantwin record --separate``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset import parts_of
from urbantwin.dataset.pose_table import EGO, frame_poses, true_and_reported
from urbantwin.dataset.reading import Dataset
from urbantwin.dataset.reading.columns import BOX
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording, open_recording
from urbantwin.geometry import Pose

__all__ = ["Labelled", "Look", "Node", "Nodes", "open_nodes"]

_EXPECTED = "a fleet, datasets of one motion, or what `urbantwin record --separate` wrote"
#: Decimals to which times of simultaneous frames agree, seconds.
_SAME = 4


@dataclass(frozen=True, eq=False)
class Look:
    """A frame of a node.

    Attributes:
        name: name of the frame in its recording.
        time_s: time of the frame, seconds of the motion.
        clock_s: time by the node's clock, seconds.
        done_s: time when the frame is complete, seconds.
        arrival_s: time of arrival by the recorded radio, seconds; None if lost.
        true: true pose of the points' frame in the site.
        reported: reported pose of the points' frame in the site.
    """

    name: str
    time_s: float
    clock_s: float
    done_s: float
    arrival_s: float | None
    true: Pose
    reported: Pose


@dataclass(frozen=True, eq=False)
class Node:
    """A node.

    Attributes:
        name: name of the node.
        number: number in messages, its index in the list.
        folder: folder of its dataset.
        looks: its frames, by number of the moment.
        track: track of its carrier; None if static.
    """

    name: str
    number: int
    folder: Path
    looks: Mapping[int, Look]
    track: int | None = None

    @cached_property
    def recording(self) -> Recording:
        """Its frames."""
        return open_recording(self.folder)

    @cached_property
    def rate_hz(self) -> float:
        """Frames per second."""
        times = sorted(look.time_s for look in self.looks.values())
        return 1.0 / float(np.median(np.diff(times))) if len(times) > 1 else 0.0

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.recording.names)}

    def frame(self, moment: int) -> Frame:
        """Return the frame of a moment, in the node's own frame of reference.

        Raises:
            InputError: its file is missing or damaged.
        """
        name = self.looks[moment].name
        if name not in self._numbers:
            raise InputError(f"has no points of frame {name}", file=self.folder, expected=_EXPECTED)
        return self.recording.read(self._numbers[name])


@dataclass(frozen=True, eq=False)
class Labelled:
    """Labelled road users at one moment, in the site frame.

    Attributes:
        box: (L, 7) boxes.
        class_names: (L,) classes of actors.
        track: (L,) int64 tracks.
        num_points: (L,) int64 points of all nodes together.
        ignored: (L,) reason why a box does not count, or empty.
    """

    box: NDArray[np.float64]
    class_names: tuple[str, ...]
    track: NDArray[np.int64]
    num_points: NDArray[np.int64]
    ignored: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes of a study.

    Attributes:
        nodes: the nodes; the receiver first.
        times_s: (K,) times of all moments, seconds of the motion.
        names: (K,) names of the moments.
        labels: function that returns the labels of a moment, with the points of given nodes.
    """

    nodes: tuple[Node, ...]
    times_s: NDArray[np.float64]
    names: tuple[str, ...]
    labels: Callable[[int, Sequence[Node]], Labelled]

    @property
    def ego(self) -> Node:
        """The receiver."""
        return self.nodes[0]

    def labelled(self, moment: int) -> Labelled:
        """Return the labels of a moment, with the points of all nodes on each.

        Raises:
            InputError: a table of labels is missing or damaged.
        """
        found, ego = self.labels(moment, self.nodes), self.ego
        ignored = tuple(
            "carries the receiver" if track == ego.track else mark
            for track, mark in zip(found.track.tolist(), found.ignored, strict=True)
        )
        return replace(found, ignored=ignored)


def open_nodes(
    paths: Sequence[Path], ego: str | None = None, only: Sequence[str] | None = None
) -> Nodes:
    """Open the nodes of a study.

    Args:
        paths: a fleet, a folder of datasets, or one dataset per node.
        ego: name of the receiver; the first node if None.
        only: names of the participating nodes, in the order of adding; all if None.

    Raises:
        InputError: fewer than two nodes of one motion, or an unknown node.
    """
    if len(paths) == 1 and (paths[0] / "fleet.json").is_file():
        every = _of_fleet(paths[0])
    else:
        every = _of_datasets(_folders(paths))
    by_name = {node.name: node for node in every.nodes}
    known = ", ".join(by_name)
    for option, asked in (("--ego", [ego] if ego else []), ("--node", only or ())):
        for name in asked:
            if name not in by_name:
                raise InputError(f"no node {name!r:.60}", place=option, expected=f"one of {known}")
    names = list(only or by_name)
    chosen = tuple(by_name[name] for name in dict.fromkeys([ego or names[0], *names]))
    if len(chosen) < 2:
        raise InputError(
            f"has {len(chosen)} node ({known})", file=paths[0], expected="two or more; " + _EXPECTED
        )
    return replace(every, nodes=chosen)


def _folders(paths: Sequence[Path]) -> dict[str, Path]:
    """Return the datasets by the names of their nodes."""
    folders: dict[str, Path] = {}
    for path in paths:
        if not (path / "dataset.json").is_file():
            raise InputError("is no dataset of ours", file=path, expected=_EXPECTED)
        for one in parts_of(path) or [path]:
            if one.resolve() in [known.resolve() for known in folders.values()]:
                raise InputError("is given twice", file=one, expected="another node's dataset")
            name = one.name if one.name not in folders else f"{path.name}-{one.name}"
            if name in folders:
                raise InputError(f"two nodes are called {name}", file=one, expected="other names")
            folders[name] = one
    return folders


def _of_datasets(folders: Mapping[str, Path]) -> Nodes:
    datasets = {name: Dataset(one) for name, one in folders.items()}
    first = next(iter(datasets))
    motion = datasets[first].manifest.get("motion_sha256")
    for name, dataset in datasets.items():
        if dataset.manifest.get("motion_sha256") != motion:
            raise InputError(
                f"is of another motion than {folders[first]}",
                file=folders[name],
                expected="nodes that saw the same traffic",
            )
    frames = {
        name: [(str(one["name"]), float(one["time_s"])) for one in dataset.manifest["frames"]]
        for name, dataset in datasets.items()
    }
    every = sorted({round(time, _SAME) for rows in frames.values() for _, time in rows})
    nodes: list[Node] = []
    names: dict[int, str] = {}
    for place, (name, dataset) in enumerate(datasets.items()):
        poses, true = frame_poses(dataset.manifest), _true_poses(dataset)
        looks = {}
        for frame, time in frames[name]:
            if frame not in poses:
                raise InputError(
                    f"does not say where frame {frame} is", file=folders[name], expected=_EXPECTED
                )
            moment = every.index(round(time, _SAME))
            names.setdefault(moment, frame)
            pose = poses[frame]
            looks[moment] = Look(frame, time, time, time, time, true.get(frame, pose), pose)
        carrier = (dataset.manifest.get("rig") or {}).get("carrier")
        track = carrier if isinstance(carrier, int) else None
        nodes.append(Node(name, place, folders[name], looks, track))
    ordered = tuple(names[moment] for moment in range(len(every)))
    return Nodes(tuple(nodes), np.array(every), ordered, _labels_of_datasets)


def _true_poses(dataset: Dataset) -> dict[str, Pose]:
    """Return the true poses of frames on a vehicle, by name, from those of the vehicle."""
    poses, found = frame_poses(dataset.manifest), {}
    for row in dataset.poses.to_pylist():
        name = str(row["frame"])
        if row["name"] == EGO and name in poses:
            true, reported = true_and_reported(row)
            found[name] = true @ reported.inverse() @ poses[name]
    return found


def _labels_of_datasets(moment: int, nodes: Sequence[Node]) -> Labelled:
    """Return the labels of all datasets together: the box with most points of each object.

    An object counts if it counts for one node.
    """
    rows: dict[int, tuple[int, int, NDArray[np.float64], str, str]] = {}
    for node in nodes:
        if moment not in node.looks:
            continue
        boxes = node.frame(moment).moved(node.looks[moment].true).boxes
        if boxes is None or boxes.num_points is None:
            raise InputError("has no labels", file=node.folder, expected=_EXPECTED)
        marks = boxes.ignored or ("",) * len(boxes)
        for row, track in enumerate(boxes.track.tolist()):
            points = int(boxes.num_points[row])
            label = (points, boxes.box[row], boxes.class_names[row], marks[row])
            total, *before = rows.get(track, (0, *label))
            better = label if points > before[0] else before
            mark = better[3] if label[3] and before[3] else ""
            rows[track] = (total + points, *better[:3], mark)
    order = sorted(rows)
    return Labelled(
        box=np.array([rows[one][2] for one in order]).reshape(-1, 7),
        class_names=tuple(rows[one][3] for one in order),
        track=np.array(order, np.int64),
        num_points=np.array([rows[one][0] for one in order], np.int64),
        ignored=tuple(rows[one][4] for one in order),
    )


def _of_fleet(path: Path) -> Nodes:
    from urbantwin.dataset.reading import Fleet

    fleet = Fleet(path)
    carriers = {str(one["name"]): one.get("carrier") for one in fleet.manifest["nodes"]}
    nodes = []
    for place, name in enumerate(fleet.node_names):
        looks = {}
        for moment, frame in enumerate(fleet.names):
            state = fleet.state(frame, name)
            if state.present and state.true is not None and state.reported is not None:
                time = float(fleet.times_s[moment])
                clock = time if state.clock_s is None else state.clock_s
                done = time if state.sent_s is None else state.sent_s
                arrival = None if state.lost else state.arrival_s
                looks[moment] = Look(frame, time, clock, done, arrival, state.true, state.reported)
        carrier = carriers[name]
        track = carrier if isinstance(carrier, int) else None
        nodes.append(Node(name, place, fleet.folder_of(name), looks, track))

    def labels(moment: int, nodes: Sequence[Node]) -> Labelled:
        table = fleet.boxes_of(fleet.names[moment])
        points = np.zeros(table.num_rows, np.int64)
        for node in nodes:
            seen = table[f"num_points.{node.name}"].to_pylist()
            points += np.array([one or 0 for one in seen], np.int64)
        return Labelled(
            box=np.column_stack([table[one].to_numpy() for one in BOX]).reshape(-1, 7),
            class_names=tuple(table["class"].to_pylist()),
            track=table["track"].to_numpy().astype(np.int64),
            num_points=points,
            ignored=tuple(one or "" for one in table["ignored"].to_pylist()),
        )

    return Nodes(tuple(nodes), fleet.times_s, fleet.names, labels)
