"""What the boxes of a dataset are like: how many, how large, how far and how densely met."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest

__all__ = ["BoxStatistics", "ClassFigures", "read_statistics"]

_EXPECTED = "the boxes of a dataset"
_KINDS = {
    "frame": "text",
    "track": "whole",
    "class": "text",
    "num_points": "whole",
    **dict.fromkeys(("x", "y", "z", "length", "width", "height"), "number"),
}
_LEVELS = ("difficulty", "ignored")
_EYES = {"frame": "text", **dict.fromkeys(("true_x", "true_y", "true_z"), "number")}


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
    kind: NDArray[np.object_]
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
    file = folder / "boxes.parquet"
    read = read_parquet(file, _EXPECTED, columns=[*_KINDS, *_LEVELS])
    levels = {name: "text or none" for name in _LEVELS if name in read.column_names}
    table = columns_of(read, _KINDS | levels, file, _EXPECTED)
    number = {name: index for index, name in enumerate(names)}
    kept = np.array([name in number for name in table["frame"]], bool)
    table = {name: values[kept] for name, values in table.items()}
    frame = np.array([number[name] for name in table["frame"]], np.int64)
    xyz = np.column_stack([table[axis] for axis in "xyz"]).reshape(-1, 3)
    eyes = _eyes(folder, manifest, number)
    site_xy, range_m = np.zeros((len(frame), 2)), np.full(len(frame), np.nan)
    for index, told in enumerate(manifest.get("frames", [])):
        mine = np.flatnonzero(frame == index) if len(frame) else frame
        rows = told.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
        if rows is None or not len(mine):
            continue
        site = pose_of_matrix(rows).inverse().apply(xyz[mine])
        site_xy[mine] = site[:, :2]
        if len(eyes.get(index, ())):
            away = np.hypot(*(site[:, None, :2] - eyes[index][None, :, :2]).transpose(2, 0, 1))
            range_m[mine] = away.min(axis=1)
    return BoxStatistics(
        frames=tuple(names),
        frame=frame,
        kind=table["class"],
        track=table["track"],
        points=table["num_points"],
        size_m=np.column_stack([table[one] for one in ("length", "width", "height")]).reshape(
            -1, 3
        ),
        site_xy=site_xy,
        range_m=range_m,
        **{name: _counted(table.get(name)) for name in _LEVELS},
    )


def _counted(values: NDArray[Any] | None) -> dict[str, int]:
    """Return how often each text of a column stands there, the most frequent first."""
    texts = Counter(str(one) for one in (() if values is None else values) if one is not None)
    return dict(sorted(texts.items(), key=lambda one: (-one[1], one[0])))


def _eyes(
    folder: Path, manifest: Mapping[str, Any], number: Mapping[str, int]
) -> dict[int, NDArray[np.float64]]:
    """Return where the sensors are in each frame, (S, 3), in the site."""
    file = folder / "sweeps.parquet"
    if not file.is_file():
        places = [one["site_SE3_sensor"] for one in manifest["rig"]["sensors"]]
        fixed = np.array(places, np.float64).reshape(-1, 4, 4)[:, :3, 3]
        return dict.fromkeys(number.values(), fixed)
    expected = "the sweeps of a dataset"
    table = columns_of(read_parquet(file, expected, columns=list(_EYES)), _EYES, file, expected)
    eyes = np.column_stack([table[f"true_{axis}"] for axis in "xyz"])
    frames = np.array([number.get(name, -1) for name in table["frame"]], np.int64)
    order = np.argsort(frames, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(frames[order])) + 1) if len(order) else []
    return {int(frames[part[0]]): eyes[part] for part in parts}
