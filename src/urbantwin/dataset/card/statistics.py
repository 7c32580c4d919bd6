"""What the boxes of a dataset are like: how many, how large, how far and how densely met."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.dataset.reading.turns import SensorTurns

__all__ = ["BoxStatistics", "ClassFigures", "read_statistics"]


@dataclass(frozen=True)
class ClassFigures:
    """One class of actors.

    Attributes:
        name: of the class.
        boxes: of all frames.
        with_points: those of them that have a point.
        tracks: actors that any frame has; ``None``, as what follows, where no table tells.
        seen_tracks: those of them that have a point in a frame.
        size_m: length, width and height: median of the tracks.
        range_m, points: medians of the boxes with points; ``None`` without any.
    """

    name: str
    boxes: int
    with_points: int
    tracks: int | None = None
    seen_tracks: int | None = None
    size_m: tuple[float, float, float] | None = None
    range_m: float | None = None
    points: float | None = None


@dataclass(frozen=True, eq=False)
class BoxStatistics:
    """All boxes of a dataset.

    Attributes:
        frames: names of the frames in the order of time.
        frame: (B,) which of them a box is in.
        kind: (B,) its class.
        track: (B,) its actor.
        points: (B,) points on it.
        size_m: (B, 3) length, width, height.
        site_xy: (B, 2) its middle in the site, metres east and north.
        range_m: (B,) how far it is in plan from the nearest sensor; nan where that is not known.
        difficulty: level -> how many boxes; empty where the table has none.
        ignored: why boxes do not count -> how many.
    """

    frames: tuple[str, ...]
    frame: NDArray[np.int64]
    kind: NDArray[np.str_]
    track: NDArray[np.int64]
    points: NDArray[np.int64]
    size_m: NDArray[np.float64]
    site_xy: NDArray[np.float64]
    range_m: NDArray[np.float64]
    difficulty: Mapping[str, int]
    ignored: Mapping[str, int]

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """(B,) whether a box has a point."""
        return self.points > 0

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The classes that have a box, the most frequent first."""
        names, counts = np.unique(self.kind.astype(str), return_counts=True)
        return tuple(names[np.lexsort((names, -counts))].tolist())

    def counted(self, frames: Iterable[str]) -> tuple[int, int]:
        """Return how many boxes some frames have, and how many of these have a point."""
        wanted = set(frames)
        inside = np.array([name in wanted for name in self.frames], bool)
        mine = inside[self.frame] if len(self.frame) else np.zeros(0, bool)
        return int(mine.sum()), int((mine & self.seen).sum())

    def track_sizes(self, name: str) -> NDArray[np.float64]:
        """Return length, width and height (T, 3) of each actor of a class: medians of its boxes."""
        mine = np.flatnonzero(self.kind == name)
        mine = mine[np.argsort(self.track[mine], kind="stable")]
        parts = np.split(mine, np.flatnonzero(np.diff(self.track[mine])) + 1) if len(mine) else []
        return np.array([np.median(self.size_m[one], axis=0) for one in parts]).reshape(-1, 3)

    def figures(self, name: str) -> ClassFigures:
        """Return what the boxes of a class are like, of which there are some."""
        mine = np.flatnonzero(self.kind == name)
        sizes = self.track_sizes(name)
        seen = mine[self.seen[mine]]
        known = seen[np.isfinite(self.range_m[seen])]
        length, width, height = np.median(sizes, axis=0).tolist()
        return ClassFigures(
            name=name,
            boxes=len(mine),
            with_points=len(seen),
            tracks=len(sizes),
            seen_tracks=len(np.unique(self.track[seen])),
            size_m=(length, width, height),
            range_m=float(np.median(self.range_m[known])) if len(known) else None,
            points=float(np.median(self.points[seen])) if len(seen) else None,
        )


def read_statistics(folder: Path) -> BoxStatistics:
    """Read the boxes of a dataset.

    Raises:
        InputError: it is no dataset, or a table of it is damaged.
    """
    manifest = read_manifest(folder)
    names = [one["name"] for one in manifest.get("frames", [])]
    number = {name: index for index, name in enumerate(names)}
    objects = LabelledObjects.in_folder(folder)
    objects = objects.take(np.array([name in number for name in objects.frame], bool))
    frame = np.array([number[name] for name in objects.frame], np.int64)
    turns = SensorTurns.in_folder(folder)
    site_xy, range_m = np.zeros((len(frame), 2)), np.full(len(frame), np.nan)
    for index, told in enumerate(manifest.get("frames", [])):
        mine = np.flatnonzero(frame == index) if len(frame) else frame
        rows = told.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
        if rows is None or not len(mine):
            continue
        site = pose_of_matrix(rows).inverse().apply(objects.box[mine, :3])
        site_xy[mine] = site[:, :2]
        eyes = turns.true[turns.of_frame(told["name"])]
        if len(eyes):
            away = np.hypot(*(site[:, None, :2] - eyes[None, :, :2]).transpose(2, 0, 1))
            range_m[mine] = away.min(axis=1)
    return BoxStatistics(
        frames=tuple(names),
        frame=frame,
        kind=objects.class_name,
        track=objects.track,
        points=objects.num_points,
        size_m=objects.box[:, 3:6],
        site_xy=site_xy,
        range_m=range_m,
        difficulty=_counted(objects.difficulty),
        ignored=_counted(objects.ignored),
    )


def _counted(values: NDArray[np.str_]) -> dict[str, int]:
    """Return how often each text of a column stands there, the most frequent first."""
    texts = Counter(one for one in values.tolist() if one)
    return dict(sorted(texts.items(), key=lambda one: (-one[1], one[0])))
