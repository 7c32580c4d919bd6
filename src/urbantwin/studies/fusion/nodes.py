"""The nodes of a study: who looked when and from where, and what all of them together could see.

They come from a fleet (``urbantwin record --nodes``), or from datasets of one motion: one for each
node, or the datasets of each sensor that ``urbantwin record --separate`` writes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

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

if TYPE_CHECKING:
    from urbantwin.dataset.reading import Fleet

__all__ = ["Labelled", "Look", "Node", "Nodes", "open_nodes"]

_EXPECTED = "a fleet, datasets of one motion, or what `urbantwin record --separate` wrote"
#: Frames whose times are the same to so many decimals of a second are of one moment.
_SAME = 4


@dataclass(frozen=True, eq=False)
class Look:
    """One frame of one node.

    Attributes:
        name: of the frame in its recording.
        time_s: when it was taken, seconds of the motion.
        clock_s: what the node's clock said then.
        done_s: when the node had all of it.
        arrival_s: when the others have it, by the radio that was recorded; None: it was lost.
        true: where the frame of its points was in the site.
        reported: the same as the node believes.
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
    """One node.

    Attributes:
        name: of it.
        number: in messages; its place in the list.
        folder: of its dataset.
        looks: its frames by the number of the moment.
        track: of the actor that carries it; None where it stands.
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
        """How many frames a second it takes."""
        times = sorted(look.time_s for look in self.looks.values())
        return 1.0 / float(np.median(np.diff(times))) if len(times) > 1 else 0.0

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.recording.names)}

    def frame(self, moment: int) -> Frame:
        """Read the points of a moment, in the node's own frame.

        Raises:
            InputError: its file is missing or bad.
        """
        name = self.looks[moment].name
        if name not in self._numbers:
            raise InputError(f"has no points of frame {name}", file=self.folder, expected=_EXPECTED)
        return self.recording.read(self._numbers[name])


@dataclass(frozen=True, eq=False)
class Labelled:
    """Who was there at one moment, in the site.

    Attributes:
        box: (L, 7).
        class_names: (L,) classes of actors.
        track: (L,) int64.
        num_points: (L,) int64 points of all nodes together.
        ignored: (L,) why each neither helps nor hurts; empty where it counts.
    """

    box: NDArray[np.float64]
    class_names: tuple[str, ...]
    track: NDArray[np.int64]
    num_points: NDArray[np.int64]
    ignored: tuple[str, ...]


class _Source(Protocol):
    def labelled(self, moment: int, nodes: Sequence[Node]) -> Labelled: ...


@dataclass(frozen=True, eq=False)
class Nodes:
    """The nodes of a study.

    Attributes:
        nodes: the receiver first.
        times_s: (K,) of all moments, seconds of the motion.
        names: (K,) of them.
        source: of the labels.
    """

    nodes: tuple[Node, ...]
    times_s: NDArray[np.float64]
    names: tuple[str, ...]
    source: _Source

    @property
    def ego(self) -> Node:
        """The receiver."""
        return self.nodes[0]

    def labelled(self, moment: int) -> Labelled:
        """Return who was there, and how many points all nodes have on each.

        Raises:
            InputError: a table of labels is missing or bad.
        """
        return self.source.labelled(moment, self.nodes)


def open_nodes(
    paths: Sequence[Path], ego: str | None = None, only: Sequence[str] | None = None
) -> Nodes:
    """Open the nodes of a study.

    Args:
        paths: a fleet, a folder of datasets, or a dataset for each node.
        ego: name of the receiver; the first node when None.
        only: names of the nodes that take part, in the order in which they are added; all if None.

    Raises:
        InputError: there are not two nodes of one motion, or one is unknown.
    """
    if len(paths) == 1 and (paths[0] / "fleet.json").is_file():
        found, times, names, source = _of_fleet(paths[0])
    else:
        found, times, names, source = _of_datasets(_folders(paths))
    known = ", ".join(one.name for one in found)
    for option, asked in (("--ego", [ego] if ego else []), ("--node", only or ())):
        for name in asked:
            if name not in [one.name for one in found]:
                raise InputError(f"no node {name!r:.60}", place=option, expected=f"one of {known}")
    chosen = [one for name in only for one in found if one.name == name] if only else list(found)
    first = next((one for one in found if one.name == ego), chosen[0])
    chosen = [first, *(one for one in dict.fromkeys(chosen) if one is not first)]
    if len(chosen) < 2:
        raise InputError(
            f"has {len(chosen)} node ({known})", file=paths[0], expected="two or more; " + _EXPECTED
        )
    return Nodes(tuple(chosen), times, names, source)


def _folders(paths: Sequence[Path]) -> dict[str, Path]:
    folders: dict[str, Path] = {}
    for path in paths:
        if not (path / "dataset.json").is_file():
            raise InputError("is no dataset of ours", file=path, expected=_EXPECTED)
        parts = parts_of(path)
        for one in parts or [path]:
            if one.resolve() in [known.resolve() for known in folders.values()]:
                raise InputError("is given twice", file=one, expected="another node's dataset")
            name = one.name if one.name not in folders else f"{path.name}-{one.name}"
            if name in folders:
                raise InputError(f"two nodes are called {name}", file=one, expected="other names")
            folders[name] = one
    return folders


def _of_datasets(
    folders: Mapping[str, Path],
) -> tuple[list[Node], NDArray[np.float64], tuple[str, ...], _Source]:
    datasets = {name: Dataset(one) for name, one in folders.items()}
    manifests = {name: one.manifest for name, one in datasets.items()}
    first = next(iter(folders))
    for name, told in manifests.items():
        if told.get("motion_sha256") != manifests[first].get("motion_sha256"):
            raise InputError(
                f"is of another motion than {folders[first]}",
                file=folders[name],
                expected="nodes that saw the same traffic",
            )
    every = sorted(
        {
            round(float(one["time_s"]), _SAME)
            for told in manifests.values()
            for one in told["frames"]
        }
    )
    number = {time: moment for moment, time in enumerate(every)}
    nodes: list[Node] = []
    names: dict[int, str] = {}
    for place, (name, told) in enumerate(manifests.items()):
        poses, true = frame_poses(told), _true_poses(datasets[name])
        looks = {}
        for one in told["frames"]:
            frame, time = str(one["name"]), float(one["time_s"])
            if frame not in poses:
                raise InputError(
                    f"does not say where frame {frame} is", file=folders[name], expected=_EXPECTED
                )
            moment = number[round(time, _SAME)]
            names.setdefault(moment, frame)
            true_pose = true.get(frame, poses[frame])
            looks[moment] = Look(frame, time, time, time, time, true_pose, poses[frame])
        carrier = (told.get("rig") or {}).get("carrier")
        track = carrier if isinstance(carrier, int) else None
        nodes.append(Node(name, place, folders[name], looks, track))
    ordered = tuple(names[moment] for moment in range(len(every)))
    return nodes, np.array(every), ordered, _LabelsOfDatasets()


def _true_poses(dataset: Dataset) -> dict[str, Pose]:
    """Return where riding frames truly were, by name: the true pose of their vehicle says it."""
    found = {}
    for row in dataset.poses.to_pylist():
        if row["name"] == EGO:
            true, reported = true_and_reported(row)
            found[str(row["frame"])] = true @ reported.inverse()
    poses = frame_poses(dataset.manifest)
    return {name: off @ poses[name] for name, off in found.items() if name in poses}


class _LabelsOfDatasets:
    """The labels of all datasets together: who is in several has the box with most points."""

    def __init__(self) -> None:
        self._frames: dict[tuple[str, int], Frame] = {}

    def labelled(self, moment: int, nodes: Sequence[Node]) -> Labelled:
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
                told = (points, boxes.box[row], boxes.class_names[row], marks[row])
                before = rows.get(track)
                if before is None:
                    rows[track] = (points, *told)
                else:
                    better = told if points > before[1] else before[1:]
                    # What counts for one node counts.
                    mark = "" if not (told[3] and before[4]) else better[3]
                    rows[track] = (before[0] + points, *better[:3], mark)
        for node in nodes[:1]:  # the receiver's own vehicle
            if node.track in rows:
                rows[node.track] = (*rows[node.track][:4], "carries the receiver")
        order = sorted(rows)
        return Labelled(
            box=np.array([rows[one][2] for one in order]).reshape(-1, 7),
            class_names=tuple(rows[one][3] for one in order),
            track=np.array(order, np.int64),
            num_points=np.array([rows[one][0] for one in order], np.int64),
            ignored=tuple(rows[one][4] for one in order),
        )


def _of_fleet(
    path: Path,
) -> tuple[list[Node], NDArray[np.float64], tuple[str, ...], _Source]:
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
    return nodes, fleet.times_s, fleet.names, _LabelsOfFleet(fleet)


class _LabelsOfFleet:
    """A fleet's common labels, with the points of the nodes that take part."""

    def __init__(self, fleet: Fleet) -> None:
        self._fleet = fleet

    def labelled(self, moment: int, nodes: Sequence[Node]) -> Labelled:
        table = self._fleet.boxes_of(self._fleet.names[moment])
        points = np.zeros(table.num_rows, np.int64)
        for node in nodes:
            told = table[f"num_points.{node.name}"].to_pylist()
            points += np.array([one or 0 for one in told], np.int64)
        track = table["track"].to_numpy().astype(np.int64)
        ignored = [one or "" for one in table["ignored"].to_pylist()]
        ego = nodes[0]
        return Labelled(
            box=np.column_stack([table[one].to_numpy() for one in BOX]).reshape(-1, 7),
            class_names=tuple(table["class"].to_pylist()),
            track=track,
            num_points=points,
            ignored=tuple(
                "carries the receiver" if one == ego.track else mark
                for one, mark in zip(track.tolist(), ignored, strict=True)
            ),
        )
