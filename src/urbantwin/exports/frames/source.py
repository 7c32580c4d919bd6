"""A dataset as those who write it in another format see it: frame by frame, all that is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset import parts_of
from urbantwin.dataset.reading.frame_files import FrameFiles
from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
from urbantwin.dataset.split import image_sets
from urbantwin.errors import InputError
from urbantwin.geometry import Pose, SiteFrame
from urbantwin.taxonomy import BOX_SEMANTICS

__all__ = ["FrameSource", "SourceBoxes", "SourceFrame"]

_EXPECTED = "a dataset of urbantwin record"
_BOX = ("x", "y", "z", "length", "width", "height", "yaw")
_POSE = ("x", "y", "z", "yaw", "pitch", "roll")
_BOX_COLUMNS = {
    "frame": "text",
    "track": "whole",
    "class": "text",
    **dict.fromkeys((*_BOX, "vx", "vy", "vz", "truncation", "observed_s"), "number"),
    **dict.fromkeys(("num_points", "num_points_alone"), "whole"),
}
_SWEEP_COLUMNS = {
    "frame": "text",
    "sensor": "text",
    **dict.fromkeys((f"reported_{axis}" for axis in _POSE), "number"),
}


@dataclass(frozen=True, eq=False)
class SourceBoxes:
    """The labelled boxes of a frame, in the frame of its points; B of them.

    Attributes:
        track: (B,) int64, the actor's number, the same in every frame.
        class_name: (B,) text, one of ``taxonomy.BOX_SEMANTICS``.
        box: (B, 7) float64: centre x, y, z, length, width, height in metres, yaw in radians.
        velocity: (B, 3) float64, over the ground, along the frame's axes, metres per second.
        num_points: (B,) int64, points on the actor.
        num_points_alone: (B,) int64, points that there would be with that actor alone.
        occlusion: (B,) float64, 0..1; NaN for whom no ray reaches even when alone.
        truncation: (B,) float64, 0..1.
        difficulty: (B,) ``easy``, ``moderate``, ``hard``; empty where it is ignored.
        ignored: (B,) why a box does not count (docs/labels.md); empty where it does.
        observed_s: (B,) float64, when the actor stood there, seconds from the frame's time.
        parked: (B,) bool.
        towed_by: (B,) int64, the track that it hangs on, -1 for none.
    """

    track: NDArray[np.int64]
    class_name: NDArray[np.str_]
    box: NDArray[np.float64]
    velocity: NDArray[np.float64]
    num_points: NDArray[np.int64]
    num_points_alone: NDArray[np.int64]
    occlusion: NDArray[np.float64]
    truncation: NDArray[np.float64]
    difficulty: NDArray[np.str_]
    ignored: NDArray[np.str_]
    observed_s: NDArray[np.float64]
    parked: NDArray[np.bool_]
    towed_by: NDArray[np.int64]

    def __len__(self) -> int:
        """Return how many boxes there are."""
        return len(self.track)


@dataclass(frozen=True, eq=False)
class SourceFrame:
    """A frame: N points, each with its labels and its ray, and the boxes.

    Attributes:
        name: which its files have.
        number: from 0, in the order of time.
        time_s: seconds from the start of the motion.
        points: (N, 3) float32, metres, in the dataset's frame.
        intensity: (N,) float32, 0..1.
        semantic: (N,) uint16, ids of ``taxonomy.semantic_classes``.
        instance: (N,) uint16, the actor's track, 0 for the static world.
        rays: (N,) ``sensor``, ``ring``, ``column``, ``time`` (seconds from the frame's time, by the
            sensor's clock) and ``echo``; datasets of older versions lack some.
        boxes: the labelled actors.
        site_SE3_frame: takes points to the site.
        site_SE3_sensors: pose of each sensor by name, as reported at its first turn in the frame;
            of one without a turn, that of the rig at rest.
    """

    name: str
    number: int
    time_s: float
    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    semantic: NDArray[np.uint16]
    instance: NDArray[np.uint16]
    rays: NDArray[np.void]
    boxes: SourceBoxes
    site_SE3_frame: Pose  # noqa: N815
    site_SE3_sensors: Mapping[str, Pose]  # noqa: N815


class FrameSource(Sequence[SourceFrame]):
    """A dataset, opened to be written in another format; frames are read when they are asked for.

    Args:
        folder: of the dataset.

    Attributes:
        folder: where it is.
        manifest: ``dataset.json``.
        names: of the frames, in the order of time.
        times_s: (F,) seconds from the start of the motion.

    Raises:
        InputError: it is no dataset, or one with a dataset for each sensor.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.manifest: dict[str, Any] = read_manifest(folder)
        if self.manifest["kind"] != "dataset":
            parts = ", ".join(part.name for part in parts_of(folder))
            raise InputError(
                "holds a dataset for each sensor", file=folder, expected=f"one of them: {parts}"
            )
        told = self.manifest["frames"]
        self.names: tuple[str, ...] = tuple(one["name"] for one in told)
        self.times_s = np.array([one["time_s"] for one in told], np.float64)

    @cached_property
    def sensors(self) -> tuple[Mapping[str, Any], ...]:
        """The sensors as the manifest has them, in the order of ``rays["sensor"]``."""
        return tuple(self.manifest["rig"]["sensors"])

    @property
    def site(self) -> SiteFrame:
        """The site's frame of reference: where on the Earth its origin is."""
        anchor = self.manifest["anchor"]
        return SiteFrame(float(anchor["latitude"]), float(anchor["longitude"]))

    @property
    def rate_hz(self) -> float:
        """Frames a second of the rig."""
        return float(self.manifest["rig"]["rate_hz"])

    @cached_property
    def split(self) -> dict[str, tuple[str, ...]]:
        """Names of the frames of each part: ``train``, ``val`` and ``test``, as far as they are."""
        found = {}
        for part, names in sorted(image_sets(self.folder).items()):
            unknown = next((one for one in names if one not in self._numbers), None)
            if unknown is not None:
                raise InputError(
                    f"names the frame {unknown[:40]}",
                    file=self.folder / "ImageSets" / f"{part}.txt",
                    expected="frames of the dataset",
                )
            found[part] = tuple(names)
        return found

    def part_of(self, name: str) -> str | None:
        """Return which part of the split a frame is in; ``None`` for a frame of none."""
        return self._parts.get(name)

    def site_SE3_frame(self, index: int) -> Pose:  # noqa: N802
        """Return what takes the points of a frame to the site; no file is read."""
        told = self.manifest["frames"][index]
        frame_SE3_site = told.get("dataset_SE3_site") or self.manifest["dataset_SE3_site"]
        if frame_SE3_site is None:
            raise InputError(
                "says not where the points are",
                file=self.folder / "dataset.json",
                place=f"frames: {told['name']}",
                expected="dataset_SE3_site",
            )
        return pose_of_matrix(frame_SE3_site).inverse()

    @cached_property
    def class_names(self) -> tuple[str, ...]:
        """The classes that any box of it has."""
        counts = self.manifest["counts"]["boxes"]
        return tuple(name for name, count in counts.items() if count)

    def __len__(self) -> int:
        """Return how many frames there are."""
        return len(self.names)

    def __getitem__(self, index: int) -> SourceFrame:  # type: ignore[override]
        """Read the frame of a number.

        Raises:
            InputError: a file of it is missing or damaged.
        """
        name = self.names[index]
        files = FrameFiles(self.folder, name)
        labels = files.labels
        return SourceFrame(
            name=name,
            number=index,
            time_s=float(self.times_s[index]),
            points=files.points[:, :3],
            intensity=files.points[:, 3],
            semantic=(labels & 0xFFFF).astype(np.uint16),
            instance=(labels >> 16).astype(np.uint16),
            rays=files.rays,
            boxes=self.boxes_of(name),
            site_SE3_frame=self.site_SE3_frame(index),
            site_SE3_sensors=self._places.get(name, {}) | self._missing_places(name),
        )

    def __iter__(self) -> Iterator[SourceFrame]:
        """Read the frames one after the other; nothing of one is kept for the next."""
        return (self[number] for number in range(len(self)))

    def boxes_of(self, name: str) -> SourceBoxes:
        """Return the boxes of a frame."""
        first, last = self._rows.get(name, (0, 0))
        column = {key: values[first:last] for key, values in self._boxes.items()}
        return SourceBoxes(
            track=column["track"],
            class_name=column["class"].astype(str),
            box=np.column_stack([column[axis] for axis in _BOX]).reshape(-1, 7),
            velocity=np.column_stack([column[axis] for axis in ("vx", "vy", "vz")]).reshape(-1, 3),
            num_points=column["num_points"],
            num_points_alone=column["num_points_alone"],
            occlusion=column["occlusion"],
            truncation=column["truncation"],
            difficulty=column["difficulty"],
            ignored=column["ignored"],
            observed_s=column["observed_s"],
            parked=column["parked"],
            towed_by=column["towed_by"],
        )

    @cached_property
    def _parts(self) -> dict[str, str]:
        return {name: part for part, names in self.split.items() for name in names}

    @cached_property
    def _numbers(self) -> frozenset[str]:
        return frozenset(self.names)

    @cached_property
    def _boxes(self) -> dict[str, NDArray[Any]]:
        """Columns of ``boxes.parquet`` in the order of frames, without nulls."""
        file = self.folder / "boxes.parquet"
        table = read_parquet(file, _EXPECTED)
        found = columns_of(table, _BOX_COLUMNS, file, _EXPECTED)
        rows = table.num_rows
        for name, missing in (("occlusion", np.nan), ("towed_by", -1), ("parked", False)):
            held = [missing] * rows
            if name in table.column_names:
                held = [missing if v is None else v for v in table[name].to_pylist()]
            found[name] = np.array(held, {"towed_by": np.int64}.get(name, type(missing)))
        for name in ("difficulty", "ignored"):
            texts = table[name].to_pylist() if name in table.column_names else [None] * rows
            found[name] = np.array([text or "" for text in texts], np.str_)
        unknown = next((one for one in found["class"] if one not in BOX_SEMANTICS), None)
        if unknown is not None:
            expected = ", ".join(BOX_SEMANTICS)
            raise InputError(
                f"has the class {str(unknown)[:40]!r}", file=file, place="class", expected=expected
            )
        frames = found["frame"].astype(str)
        order = np.lexsort((np.arange(rows), found["track"], frames))
        frame, track = frames[order], found["track"][order]
        twice = np.flatnonzero((frame[1:] == frame[:-1]) & (track[1:] == track[:-1]))
        if len(twice):
            raise InputError(
                f"has the track {track[twice[0]]} twice in frame {frame[twice[0]][:40]}",
                file=file,
                place="track",
                expected="one box of each actor in a frame",
            )
        order = np.argsort(frames, kind="stable")
        return {name: values[order] for name, values in found.items()}

    @cached_property
    def _rows(self) -> dict[str, tuple[int, int]]:
        """The first row of each frame's boxes, and the one after the last."""
        names, first, count = np.unique(
            self._boxes["frame"].astype(str), return_index=True, return_counts=True
        )
        spans = zip(names.tolist(), first.tolist(), (first + count).tolist(), strict=True)
        return {name: (start, stop) for name, start, stop in spans}

    @cached_property
    def _places(self) -> dict[str, dict[str, Pose]]:
        """Pose of each sensor at its first turn of each frame, by frame and sensor."""
        file = self.folder / "sweeps.parquet"
        column = columns_of(read_parquet(file, _EXPECTED), _SWEEP_COLUMNS, file, _EXPECTED)
        found: dict[str, dict[str, Pose]] = {}
        for row, (frame, sensor) in enumerate(zip(column["frame"], column["sensor"], strict=True)):
            own = found.setdefault(frame, {})
            if sensor not in own:
                x, y, z, yaw, pitch, roll = (column[f"reported_{axis}"][row] for axis in _POSE)
                own[sensor] = Pose.from_ypr([x, y, z], yaw, pitch, roll)
        return found

    def _missing_places(self, name: str) -> dict[str, Pose]:
        known = self._places.get(name, {})
        return {
            one["name"]: pose_of_matrix(one["site_SE3_sensor"])
            for one in self.sensors
            if one["name"] not in known
        }
