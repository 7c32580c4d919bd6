"""A LiDAR frame in the common form of all readers: points, their attributes and labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.clouds import Cloud
from urbantwin.geometry import Pose, points_in_box

__all__ = ["Boxes", "Frame"]

#: Attributes of the points, besides their position.
_OF_POINTS = (
    "intensity", "ring", "column", "time_s", "sensor", "semantic", "instance", "unlabelled",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Boxes:
    """The labelled objects of a frame.

    Attributes:
        box: (B, 7) float64 in the frame of the points: centre x, y, z, length (along heading),
            width, height in metres, yaw in radians counter-clockwise from +x.
        class_names: (B,) one of ``taxonomy.ACTOR_CLASSES``, or ``other``.
        track: (B,) int64, number of the object in all frames of its recording, -1 without a track.
        source_names: (B,) class names of the dataset.
        velocity: (B, 3) velocity over ground along the axes of the frame, metres per second; NaN
            where unknown. None if unknown for all.
        num_points: (B,) int64, number of points as the dataset counts them; None if it does not.
        occlusion: (B,) occluded share, 0..1; NaN where unknown. None if unknown for all.
        ignored: (B,) the dataset's reason to ignore a box in evaluation; empty if it counts. None
            if the dataset has no such mark.
    """

    box: NDArray[np.float64]
    class_names: tuple[str, ...]
    track: NDArray[np.int64]
    source_names: tuple[str, ...] = ()
    velocity: NDArray[np.float64] | None = None
    num_points: NDArray[np.int64] | None = None
    occlusion: NDArray[np.float64] | None = None
    ignored: tuple[str, ...] | None = None

    def __len__(self) -> int:
        """Return the number of boxes."""
        return len(self.box)

    def points_of(self, points: NDArray[np.float64], margin: float = 0.0) -> NDArray[np.int64]:
        """Return the index of the box that contains each of (N, 3) points, -1 for none.

        A point in several boxes belongs to the one with the nearest centre.

        Args:
            points: points in the frame of the boxes, metres.
            margin: growth of each box on each side, metres.
        """
        owner = np.full(len(points), -1, np.int64)
        nearest = np.full(len(points), np.inf)
        along = np.argsort(points[:, 0])
        x, y = points[along, 0], points[along, 1]
        for index, box in enumerate(self.box):
            reach = np.linalg.norm(box[3:6]) / 2 + 2 * margin
            first, last = np.searchsorted(x, (box[0] - reach, box[0] + reach))
            near = along[first:last][np.abs(y[first:last] - box[1]) <= reach]
            inside = near[points_in_box(points[near], box, margin)]
            away = np.linalg.norm(points[inside] - box[:3], axis=1)
            better = away < nearest[inside]
            owner[inside[better]] = index
            nearest[inside[better]] = away[better]
        return owner


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of points with their attributes; None where the dataset has no value.

    Attributes:
        points: (N, 3) float64, metres, N >= 1, all finite, in the dataset's frame of the points.
        intensity: (N,) float64 on the dataset's own scale.
        ring: (N,) int64, row or channel of the beam in the dataset's numbering.
        column: (N,) int64, index of the firing in the rotation.
        time_s: (N,) float64, seconds relative to the frame's time.
        sensor: (N,) int64, index of the sensor, from 0.
        semantic: (N,) int64, ids of ``taxonomy.semantic_classes``.
        instance: (N,) int64, number of the object, 0 for none.
        unlabelled: (N,) bool, points in zones without labels; None if there are no such zones.
        boxes: labelled objects; None without labels (zero rows without objects).
        world_SE3_frame: pose of the points' frame in the recording's world frame.
        sensor_places: (S, 3) float64, sensor positions in the frame of the points, metres.
        name: name of the frame, without a folder.
        not_finite: number of points left out because a value was NaN or infinite.
        no_return: number of points left out because they were exactly (0, 0, 0): beams without a
            return.
        notes: notes on this frame that qualify results, one sentence each.
    """

    points: NDArray[np.float64]
    intensity: NDArray[np.float64] | None = None
    ring: NDArray[np.int64] | None = None
    column: NDArray[np.int64] | None = None
    time_s: NDArray[np.float64] | None = None
    sensor: NDArray[np.int64] | None = None
    semantic: NDArray[np.int64] | None = None
    instance: NDArray[np.int64] | None = None
    unlabelled: NDArray[np.bool_] | None = None
    boxes: Boxes | None = None
    world_SE3_frame: Pose | None = None  # noqa: N815
    sensor_places: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3)))
    name: str = ""
    not_finite: int = 0
    no_return: int = 0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError for arrays of another length: a reader's mistake, never a file's."""
        for name, values in self._of_points().items():
            if len(values) != len(self.points):
                raise ValueError(f"{name}: {len(values)} values for {len(self.points)} points")

    @property
    def cloud(self) -> Cloud:
        """The points with their intensity, without other attributes."""
        return Cloud(self.points, self.intensity, self.not_finite, self.no_return)

    def only(self, chosen: ArrayLike) -> Frame:
        """Return the frame with the points of a mask (N,) or of indices; all else is unchanged."""
        rows = np.asarray(chosen)
        kept = {name: values[rows] for name, values in self._of_points().items()}
        return replace(self, points=self.points[rows], **kept)

    def foreground(self, margin: float = 0.0) -> NDArray[np.bool_] | None:
        """Return the mask (N,) of points on labelled objects; None without labels.

        These are points in a box (grown by ``margin`` metres on each side), or of an instance > 0.
        Points on unlabelled objects count as background.
        """
        if self.boxes is None and self.instance is None:
            return None
        found = np.zeros(len(self.points), bool)
        if self.instance is not None:
            found |= self.instance > 0
        if self.boxes is not None:
            found |= self.boxes.points_of(self.points, margin) >= 0
        return found

    def moved(self, outer_SE3_frame: Pose) -> Frame:
        """Return the frame with points, boxes and sensors in another frame.

        Boxes stay upright: only their heading follows the rotation.
        """
        boxes = self.boxes
        if boxes is not None:
            box = boxes.box.copy()
            box[:, :3] = outer_SE3_frame.apply(box[:, :3])
            ahead = np.column_stack([np.cos(box[:, 6]), np.sin(box[:, 6]), np.zeros(len(box))])
            ahead = ahead @ outer_SE3_frame.rotation.T
            box[:, 6] = np.arctan2(ahead[:, 1], ahead[:, 0])
            velocity = boxes.velocity
            if velocity is not None:
                velocity = velocity @ outer_SE3_frame.rotation.T
            boxes = replace(boxes, box=box, velocity=velocity)
        world = self.world_SE3_frame
        return replace(
            self,
            points=outer_SE3_frame.apply(self.points),
            boxes=boxes,
            sensor_places=outer_SE3_frame.apply(self.sensor_places),
            world_SE3_frame=None if world is None else world @ outer_SE3_frame.inverse(),
        )

    def _of_points(self) -> Mapping[str, NDArray[np.generic]]:
        mine = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: mine[name] for name in _OF_POINTS if mine[name] is not None}
