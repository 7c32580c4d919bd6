"""One labelled frame of a recorded dataset, as pictures need it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.artefact.tables import columns_of, read_parquet
from urbantwin.dataset.ignore_regions import IGNORE_REGIONS, read_ignore_regions
from urbantwin.dataset.reading.frame_files import FrameFiles, ray_place
from urbantwin.dataset.reading.manifest import pose_of_matrix, read_manifest
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

__all__ = ["LabelledPoints", "SensorPlace", "read_labelled_points"]

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
    manifest = _manifest(dataset)
    table = _boxes(dataset)
    names = [frame["name"] for frame in manifest["frames"]]
    if name is None:
        name = _busiest(names, table)
    if name not in names:
        raise InputError(f"has no frame {name}", file=dataset, expected="a frame of the dataset")
    kept = FrameFiles(dataset, name)
    points, label, rays = kept.points, kept.labels, kept.rays
    lacking = sorted({"sensor", "ring", "column"} - set(rays.dtype.names or ()))
    if lacking:
        raise InputError(
            f"has no {lacking[0]}",
            file=kept.rays_file,
            expected="sensor, ring and column of each point",
        )
    sensors = manifest["rig"]["sensors"]
    if len(rays) and int(rays["sensor"].max()) >= len(sensors):
        raise InputError(
            "names a sensor that is not there",
            file=kept.rays_file,
            place=ray_place(kept.rays_file, rays, "sensor", int(np.argmax(rays["sensor"])))
            if kept.is_plain
            else None,
            expected=f"numbers below {len(sensors)}",
        )
    mine = np.flatnonzero(table["frame"] == name)
    told = manifest["frames"][names.index(name)]
    matrix = told.get("dataset_SE3_site") or manifest["dataset_SE3_site"]
    if matrix is None:
        raise InputError("is missing", file=dataset / "dataset.json", place="dataset_SE3_site")
    dataset_SE3_site = pose_of_matrix(matrix)
    moved = _poses_of_turns(dataset, name) if manifest["dataset_SE3_site"] is None else {}
    return LabelledPoints(
        name=name,
        time_s=float(told["time_s"]),
        points=points,
        semantic=label & 0xFFFF,
        instance=label >> 16,
        boxes=np.column_stack([table[key][mine] for key in _BOX]).reshape(-1, 7),
        classes=tuple(table["class"][mine]),
        box_points=table["num_points"][mine],
        sensors=tuple(
            SensorPlace(
                one["name"],
                one["model"],
                int(one["columns"]),
                np.array(one["sensor"]["elevation_deg"], np.float64),
                dataset_SE3_site @ moved.get(one["name"], pose_of_matrix(one["site_SE3_sensor"])),
                one["sensor"].get("pattern") is not None,
            )
            for one in sensors
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


def _busiest(names: Sequence[str], table: Mapping[str, NDArray[Any]]) -> str:
    """Return the frame in which the most actors have points; the first of equals."""
    seen = Counter(table["frame"][table["num_points"] > 0].tolist())
    return max(names, key=lambda name: seen[name])


def _manifest(dataset: Path) -> dict[str, Any]:
    manifest = read_manifest(dataset)
    if manifest["kind"] != "dataset":
        raise InputError("holds a dataset for each sensor", file=dataset, expected="one of them")
    return manifest


def _poses_of_turns(dataset: Path, frame: str) -> dict[str, Pose]:
    """Return where each sensor of a rig that rides was when its first turn of a frame began."""
    path = dataset / "sweeps.parquet"
    names = [f"reported_{name}" for name in ("x", "y", "z", "yaw", "pitch", "roll")]
    kinds = {"frame": "text", "sensor": "text", **dict.fromkeys(names, "number")}
    table = columns_of(read_parquet(path, "sweeps", columns=list(kinds)), kinds, path, "sweeps")
    return {
        table["sensor"][row]: Pose.from_ypr(
            [table[name][row] for name in names[:3]], *(table[name][row] for name in names[3:])
        )
        for row in np.flatnonzero(table["frame"] == frame)[::-1]
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
    kinds = {"frame": "text", "class": "text", "num_points": "whole"}
    kinds |= dict.fromkeys(_BOX, "number")
    table = read_parquet(path, "boxes", columns=[*kinds, "difficulty"])
    # Datasets of older versions have no levels of difficulty.
    if "difficulty" in table.column_names:
        kinds["difficulty"] = "text or none"
    return columns_of(table, kinds, path, "boxes")
