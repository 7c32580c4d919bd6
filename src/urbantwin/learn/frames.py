"""Training frames: points with heights above the ground, boxes with class indices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import detected_class
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.grid import HIGHEST_M, LOWEST_M
from urbantwin.learn.ground import Ground, ground_of, is_upside_down

__all__ = [
    "BEYOND_M",
    "COUNTED_M",
    "IGNORED",
    "LEAST_POINTS",
    "RINGS",
    "LevelFrame",
    "Levelled",
    "level_frame_from",
    "levelled",
    "read_level_frame",
    "refuse_upside_down",
    "write_level_frame",
]

#: Index of a ring in a frame: index of the sensor times this, plus the sensor's own ring.
RINGS = 4096
#: Class index of a box that training and evaluation ignore.
IGNORED = -1
#: Cell size of the mask of the labelled area, metres.
COUNTED_M = 1.0
#: A box with fewer points is ignored: evaluation skips it, and so few points may be a twig as well
#: as a person.
LEAST_POINTS = 5
#: Margin beyond the range in which points are kept, for rotated crops, metres.
BEYOND_M = 4.0
#: Largest median distance of the boxes' lower faces from the ground, metres; beyond it, z of the
#: labels is no height above this ground.
_MOST_OFF_M = 1.5


@dataclass(frozen=True, eq=False)
class LevelFrame:
    """A frame with its ground flattened, about the centre of its sensors.

    Attributes:
        points: (N, 3 or 4) float32: x and y from the centre, height above the ground (m), and
            intensity (0..1) if used.
        ring: (N,) int32: index of the sensor times `RINGS`, plus its ring; -1 where unknown.
        semantic: (N,) uint8: id of the semantic class (``taxonomy.semantic_classes``); 0: unknown.
        sensors: (S, 3) float64: positions of the sensors in the same frame, metres.
        box: (B, 7) float64: boxes, z above the ground.
        number: (B,) int64: class index of each box, or `IGNORED`.
        counted: (K, K) bool: labelled area, in cells of `COUNTED_M` about the centre.
    """

    points: NDArray[np.float32]
    ring: NDArray[np.int32]
    semantic: NDArray[np.uint8]
    sensors: NDArray[np.float64]
    box: NDArray[np.float64]
    number: NDArray[np.int64]
    counted: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Levelled:
    """A levelled frame without boxes, and how it was levelled.

    Attributes:
        frame: the levelled frame.
        ground: ground surface that was subtracted.
        middle: (2,) origin of the levelled frame: centre of the sensors, metres.
        kept: (N,) int64: rows of the original points.
    """

    frame: LevelFrame
    ground: Ground
    middle: NDArray[np.float64]
    kept: NDArray[np.int64]


def levelled(frame: Frame, reach_m: float, *, intensity: bool = False) -> Levelled:
    """Flatten the ground of a frame; boxes are not carried over.

    Args:
        frame: frame of any recording.
        reach_m: largest distance of kept points from the centre along x and y, metres.
        intensity: keep intensities (0..1).
    """
    middle = frame.sensor_places[:, :2].mean(axis=0)
    away = np.abs(frame.points[:, :2] - middle).max(axis=1)
    near = away < reach_m
    points = frame.points[near]
    if not len(points):
        points = frame.points[:1]
        near = np.arange(len(frame.points)) == 0
    ground = ground_of(points)
    above = points[:, 2] - ground.at(points)
    inside = (above >= LOWEST_M) & (above < HIGHEST_M)
    kept = np.flatnonzero(near)[inside]
    told = [points[inside, :2] - middle, above[inside, None]]
    if intensity and frame.intensity is not None:
        told.append(np.nan_to_num(frame.intensity[kept])[:, None])
    ring = np.full(len(kept), -1, np.int32)
    if frame.ring is not None:
        sensor = 0 if frame.sensor is None else frame.sensor[kept]
        row = frame.ring[kept]
        ring = np.where(row >= 0, sensor * RINGS + row, -1).astype(np.int32)
    semantic = np.zeros(len(kept), np.uint8)
    if frame.semantic is not None:
        known = frame.semantic[kept]
        semantic = np.where((known >= 0) & (known < 256), known, 0).astype(np.uint8)
    sensors = frame.sensor_places.copy()
    sensors[:, 2] -= ground.at(sensors)
    sensors[:, :2] -= middle
    found = LevelFrame(
        np.column_stack(told).astype(np.float32),
        ring,
        semantic,
        sensors,
        np.zeros((0, 7)),
        np.zeros(0, np.int64),
        np.ones((1, 1), bool),
    )
    return Levelled(found, ground, middle, kept)


def level_frame_from(
    frame: Frame,
    classes: Sequence[str],
    half_m: float,
    *,
    file: Path,
    intensity: bool = False,
    ignored: NDArray[np.bool_] | None = None,
    labelled: Callable[[Frame, NDArray[np.float64]], NDArray[np.bool_]] | None = None,
) -> LevelFrame:
    """Flatten the ground of a labelled frame.

    Args:
        frame: frame with boxes.
        classes: classes to learn; boxes of other classes are ignored.
        half_m: largest distance of a box centre from the origin along x and y, metres.
        file: source of the frame, for error messages.
        intensity: keep intensities (0..1).
        ignored: (B,) boxes that the labels mark as ignored.
        labelled: returns for boxes (N, 7) whether they lie in the fully labelled area.

    Raises:
        InputError: the frame has no boxes, z points down, or boxes do not stand on the ground.
    """
    if frame.boxes is None:
        raise InputError(
            "has no boxes", file=file, place=f"frame {frame.name}", expected="labelled frames"
        )
    refuse_upside_down(frame, file)
    level = levelled(frame, half_m + BEYOND_M, intensity=intensity)
    found, ground, middle = level.frame, level.ground, level.middle
    box, number = _boxes_of(frame.boxes, classes)
    if ignored is not None:
        number[ignored] = IGNORED
    box[:, 2] -= ground.at(box)
    box[:, :2] -= middle
    inside = np.abs(box[:, :2]).max(axis=1, initial=0) < half_m
    box, number = box[inside], number[inside]
    held = np.bincount(points_in_boxes(found.points, box, 0.05) + 1, minlength=len(box) + 1)[1:]
    number[held < LEAST_POINTS] = IGNORED
    real = held >= 10
    off = box[real, 2] - box[real, 5] / 2
    if len(off) > 2 and np.median(np.abs(off)) > _MOST_OFF_M:
        raise InputError(
            f"has boxes {np.median(off):.1f} m from the ground",
            file=file,
            place=f"frame {frame.name}",
            expected="boxes that stand on the ground, z up",
        )
    counted = np.ones((1, 1), bool)
    if labelled is not None:
        half = int(np.ceil((half_m + BEYOND_M) / COUNTED_M))
        along = (np.arange(-half, half) + 0.5) * COUNTED_M
        y, x = np.meshgrid(along, along, indexing="ij")
        cells = np.ones((x.size, 7))
        cells[:, :2] = np.column_stack([x.ravel(), y.ravel()]) + middle
        cells[:, 2], cells[:, 6] = ground.at(cells) + 0.5, 0.0
        found_there = labelled(frame, cells).reshape(x.shape)
        counted = counted if found_there.all() else found_there
    return replace(found, box=box, number=number, counted=counted)


def refuse_upside_down(frame: Frame, file: Path) -> None:
    """Raise an `InputError` for a frame in which z points down."""
    if is_upside_down(frame.points):
        raise InputError(
            "has z pointing down",
            file=file,
            place=f"frame {frame.name}",
            expected="metres with z up",
        )


def _boxes_of(
    boxes: Boxes, classes: Sequence[str]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    place = {name: number for number, name in enumerate(classes)}
    names = [detected_class(name) for name in boxes.class_names]
    number = np.array([place.get(str(name), IGNORED) for name in names], np.int64)
    return boxes.box.copy(), number


def write_level_frame(path: Path, frame: LevelFrame) -> None:
    """Write a frame as an uncompressed npz archive, which loads in milliseconds."""
    with path.open("wb") as file:
        np.savez(file, **{one.name: getattr(frame, one.name) for one in fields(frame)})


def read_level_frame(path: Path) -> LevelFrame:
    """Read a frame that `write_level_frame` wrote."""
    with np.load(path) as arrays:
        return LevelFrame(**{one.name: arrays[one.name] for one in fields(LevelFrame)})
