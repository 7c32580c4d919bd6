"""A labelled frame of a recorded dataset, in the form used by pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.dataset.ignore_regions import IGNORE_REGIONS, read_ignore_regions
from urbantwin.dataset.reading import Dataset, pose_of_matrix
from urbantwin.dataset.reading.objects import LabelledObjects
from urbantwin.errors import InputError
from urbantwin.geometry import Pose

__all__ = ["LabelledPoints", "SensorPlace", "read_labelled_points"]


@dataclass(frozen=True, eq=False)
class SensorPlace:
    """A sensor of the rig.

    Attributes:
        name, model: as in the rig.
        columns: firings per revolution.
        elevation_deg: (C,) elevation of each channel, in the order of ``ring``.
        dataset_SE3_sensor: its pose in the dataset's frame.
        has_pattern: its scan pattern does not repeat; it has no channels by columns.
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
        name: name of the frame.
        time_s: seconds from the start of the motion.
        points: (N, 4) float32, x, y, z in metres, dataset frame, and intensity 0..1.
        semantic: (N,) numbers of ``taxonomy.semantic_classes``.
        instance: (N,) track; 0 for the static scene.
        boxes: (B, 7) x, y, z, length, width, height, yaw; dataset frame.
        classes: (B,) names of ``taxonomy.ACTOR_CLASSES``.
        box_points: (B,) number of returns from each.
        sensors: the rig.
        sensor, ring, column: (N,) the ray of each point; ``None`` if unknown.
        x_axis_yaw: heading of the dataset's x axis, counter-clockwise from east, radians.
        difficulty: (B,) level of each box, ``None`` for a box that does not count; empty if
            unknown.
        ignored: areas in which labels do not count, by reason, dataset frame in plan.
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


def read_labelled_points(folder: Path, name: str | None = None) -> LabelledPoints:
    """Read a frame of a dataset; without a name, the frame with the most labelled actors.

    Raises:
        InputError: there is no dataset, no such frame, or a file of it is missing.
    """
    dataset = Dataset(folder)
    dataset.check_single()
    objects = LabelledObjects.in_folder(folder)
    if name is None:
        seen = Counter(objects.frame[objects.num_points > 0].tolist())
        name = max(dataset.names, key=lambda name: seen[name])
    if name not in dataset.names:
        raise InputError(f"has no frame {name}", file=folder, expected="a frame of the dataset")
    frame, objects = dataset[name], objects.of_frame(name)
    sensors = dataset.manifest["rig"]["sensors"]
    rays = frame.rays_of("sensor", "ring", "column", sensors=len(sensors))
    dataset_SE3_site = frame.site_SE3_dataset.inverse()
    # Only sensors of a moving rig move enough to be visible.
    moved = frame.site_SE3_sensors if dataset.manifest["dataset_SE3_site"] is None else {}
    return LabelledPoints(
        name=name,
        time_s=frame.time_s,
        points=frame.points,
        semantic=frame.labels & 0xFFFF,
        instance=frame.labels >> 16,
        boxes=objects.box,
        classes=tuple(objects.class_name.tolist()),
        box_points=objects.num_points,
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
        difficulty=tuple(one or None for one in objects.difficulty.tolist()),
        ignored=_ignored(folder, dataset_SE3_site),
    )


def _ignored(dataset: Path, dataset_SE3_site: Pose) -> dict[str, shapely.Geometry]:
    """Return areas in which labels do not count, in plan in the dataset's frame."""
    path = dataset / IGNORE_REGIONS
    if not path.is_file():
        return {}
    turn, place = dataset_SE3_site.rotation[:2, :2], dataset_SE3_site.translation[:2]
    return {
        one.reason: shapely.transform(one.area, lambda xy: xy @ turn.T + place)
        for one in read_ignore_regions(path)
    }
