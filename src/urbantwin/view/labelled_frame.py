"""One labelled frame of a recorded dataset, as pictures need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import shapely
from numpy.typing import NDArray

from urbantwin.artefact import read_json
from urbantwin.dataset.ignore_regions import IGNORE_REGIONS, read_ignore_regions
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

__all__ = ["LabelledPoints", "SensorPlace", "busiest_frame", "read_labelled_points"]

_BOX = ("x", "y", "z", "length", "width", "height", "yaw")


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """A sensor of the rig.

    Attributes:
        name, model: as in the rig.
        columns: firings per turn.
        elevation_deg: (C,) of each channel, as ``ring`` numbers them.
        dataset_SE3_sensor: its place in the dataset's frame.
        has_pattern: it scans a pattern that does not repeat, not channels by columns.
    """

    name: str
    model: str
    columns: int
    elevation_deg: NDArray[np.float64]
    dataset_SE3_sensor: Pose  # noqa: N815
    has_pattern: bool = False


@dataclass(frozen=True, eq=False)
class LabelledPoints:
    """One frame.

    Attributes:
        name: of the frame.
        time_s: seconds from the start of the motion.
        points: (N, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        semantic: (N,) numbers of ``taxonomy.semantic_classes``.
        instance: (N,) track; 0 for the static world.
        boxes: (B, 7) x, y, z, length, width, height, yaw; dataset frame.
        classes: (B,) names of ``taxonomy.ACTOR_CLASSES``.
        box_points: (B,) returns from each.
        sensors: the rig.
        sensor, ring, column: (N,) the ray of each point; None if not known.
        x_axis_yaw: heading of the dataset's x axis, counter-clockwise from east, radians.
        difficulty: (B,) level of each box, ``None`` for one that does not count; empty if not
            known.
        ignored: where labels do not count, by reason, dataset frame in plan.
    """

    name: str
    time_s: float
    points: NDArray[np.float32]
    semantic: NDArray[np.integer[Any]]
    instance: NDArray[np.integer[Any]]
    boxes: NDArray[np.float64]
    classes: tuple[str, ...]
    box_points: NDArray[np.int64]
    sensors: tuple[SensorPlace, ...]
    sensor: NDArray[np.integer[Any]] | None = None
    ring: NDArray[np.integer[Any]] | None = None
    column: NDArray[np.integer[Any]] | None = None
    x_axis_yaw: float = 0.0
    difficulty: tuple[str | None, ...] = ()
    ignored: Mapping[str, shapely.Geometry] = field(default_factory=dict)


def read_labelled_points(dataset: Path, name: str | None = None) -> LabelledPoints:
    """Read a frame of a dataset; without a name the one with the most labelled actors.

    Raises:
        InputError: there is no dataset, no such frame, or a file of it is missing.
    """
    manifest = read_json(dataset / "dataset.json", kind="dataset")
    table = _boxes(dataset)
    names = [frame["name"] for frame in manifest.get("frames", [])]
    if name is None:
        name = busiest_frame(dataset)
    if name not in names:
        raise InputError(f"has no frame {name}", file=dataset, expected="a frame of the dataset")
    try:
        points = np.load(dataset / "points" / f"{name}.npy")
        label = np.fromfile(dataset / "semantic" / f"{name}.label", "<u4")
        rays = np.load(dataset / "rays" / f"{name}.npy")
    except (OSError, ValueError) as error:
        raise InputError(f"frame {name} is not readable ({error})", file=dataset) from None
    mine = np.flatnonzero(table["frame"] == name)
    told = manifest["frames"][names.index(name)]
    dataset_SE3_site = _pose(told.get("dataset_SE3_site", manifest["dataset_SE3_site"]))
    moved = _poses_of_turns(dataset, name) if manifest["dataset_SE3_site"] is None else {}
    return LabelledPoints(
        name=name,
        time_s=float(told["time_s"]),
        points=points,
        semantic=label & 0xFFFF,
        instance=label >> 16,
        boxes=np.column_stack([table[key][mine] for key in _BOX]).astype(np.float64).reshape(-1, 7),
        classes=tuple(str(one) for one in table["class"][mine]),
        box_points=table["num_points"][mine].astype(np.int64),
        sensors=tuple(
            SensorPlace(
                one["name"],
                one["model"],
                int(one["columns"]),
                np.array(one["sensor"]["elevation_deg"], np.float64),
                dataset_SE3_site @ moved.get(one["name"], _pose(one["site_SE3_sensor"])),
                one["sensor"].get("pattern") is not None,
            )
            for one in manifest["rig"]["sensors"]
        ),
        sensor=rays["sensor"],
        ring=rays["ring"],
        column=rays["column"],
        # The site's east, seen in the dataset's frame, turns the other way.
        x_axis_yaw=-float(
            np.arctan2(dataset_SE3_site.rotation[1, 0], dataset_SE3_site.rotation[0, 0])
        ),
        difficulty=tuple(table["difficulty"][mine]) if "difficulty" in table else (),
        ignored=_ignored(dataset, dataset_SE3_site),
    )


def busiest_frame(dataset: Path) -> str:
    """Return the frame in which the most actors have points; the first of equals."""
    manifest = read_json(dataset / "dataset.json", kind="dataset")
    names = [frame["name"] for frame in manifest.get("frames", [])]
    if not names:
        raise InputError("has no frames", file=dataset, expected="a recorded dataset")
    table = _boxes(dataset)
    seen, counts = np.unique(table["frame"][table["num_points"] > 0], return_counts=True)
    found = dict(zip(seen.tolist(), counts.tolist(), strict=True))
    return str(max(names, key=lambda name: found.get(name, 0)))


def _poses_of_turns(dataset: Path, frame: str) -> dict[str, Pose]:
    """Return where each sensor of a rig that rides was when its first turn of a frame began."""
    path = dataset / "sweeps.parquet"
    names = [f"reported_{name}" for name in ("x", "y", "z", "yaw", "pitch", "roll")]
    try:
        table = pq.read_table(path, columns=["frame", "sensor", *names]).to_pylist()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"is not readable ({error})", file=path) from None
    return {
        row["sensor"]: Pose.from_ypr(
            [row[name] for name in names[:3]], *(row[n] for n in names[3:])
        )
        for row in reversed(table)
        if row["frame"] == frame
    }


def _ignored(dataset: Path, dataset_SE3_site: Pose) -> dict[str, shapely.Geometry]:
    """Return where labels do not count, seen from above in the dataset's frame."""
    path = dataset / IGNORE_REGIONS
    if not path.is_file():
        return {}
    turn, place = dataset_SE3_site.rotation[:2, :2], dataset_SE3_site.translation[:2]
    return {
        one.reason: shapely.transform(one.area, lambda xy: xy @ turn.T + place)
        for one in read_ignore_regions(path)
    }


def _boxes(dataset: Path) -> dict[str, NDArray[Any]]:
    path = dataset / "boxes.parquet"
    columns = ["frame", "class", "num_points", *_BOX]
    try:
        # Datasets of older versions have no levels of difficulty.
        columns += [name for name in ("difficulty",) if name in pq.read_schema(path).names]
        table = pq.read_table(path, columns=columns)
    except (OSError, ValueError) as error:
        raise InputError(f"is not readable ({error})", file=path, expected="boxes") from None
    return {name: table[name].to_numpy(zero_copy_only=False) for name in columns}


def _pose(matrix: list[list[float]]) -> Pose:
    rows = np.array(matrix, np.float64)
    return Pose(rows[:3, :3], rows[:3, 3])
