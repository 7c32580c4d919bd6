"""Augmentation by objects pasted from other frames, with correct density and occlusion.

Like Yan et al. 2018 ("SECOND"), and beyond it: an object keeps its range and its side towards the
sensor, so that density and self-occlusion are right; points that it hides are removed, and points
of the object that the scene hides are removed. With several sensors it keeps its position.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.learn.augmentation.placement import Placement
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.frames import RINGS, LevelFrame

__all__ = ["PASTED", "ObjectBank", "bank_of", "pasted", "read_bank", "write_bank"]

#: Mean number of attempts per sample and class.
PASTED: Mapping[str, float] = {
    "car": 2.0, "truck": 1.0, "bus": 0.7, "motorcycle": 1.5, "bicycle": 2.5, "pedestrian": 4.0,
}  # fmt: skip
#: Fewest points of an object in the bank; most objects of a class and recording.
_LEAST_POINTS, _MOST_OBJECTS = 8, 600
#: Points lower than this belong to the ground, metres.
_FOOT_M = 0.08
#: Angular resolution of occlusion in azimuth and elevation, degrees: a few columns and rings.
_AROUND_DEG, _UP_DEG = 0.5, 0.8
#: Smallest range difference of hidden points, metres.
_BEHIND_M = 0.3
#: A position is occupied if it has this many points above this height (m).
_TAKEN_POINTS, _TAKEN_M = 4, 0.3
_BESIDE_M = 0.3


@dataclass(frozen=True, eq=False)
class ObjectBank:
    """Objects cut out of frames.

    Attributes:
        box: (K, 7) boxes, z above the ground.
        number: (K,) class indices.
        rig: (K,) int64: recording; objects are pasted into frames of the same recording.
        sensor: (K, 2) float64: position of the only sensor in plan; NaN with several sensors.
        first: (K + 1,) int64: points of object k are rows ``first[k]`` to ``first[k + 1]``.
        points: (N, 3 or 4) float32 in the coordinates of the original frame.
        ring: (N,) int32.
        semantic: (N,) uint8.
    """

    box: NDArray[np.float64]
    number: NDArray[np.int64]
    rig: NDArray[np.int64]
    sensor: NDArray[np.float64]
    first: NDArray[np.int64]
    points: NDArray[np.float32]
    ring: NDArray[np.int32]
    semantic: NDArray[np.uint8]


def bank_of(frames: Sequence[tuple[LevelFrame, int]], classes: int) -> ObjectBank:
    """Collect objects of frames, evenly spread over them, for each class and recording.

    Args:
        frames: frames, each with the index of its recording.
        classes: number of classes.
    """
    found: dict[tuple[int, int], list[tuple[NDArray[np.float64], ...]]] = {}
    for frame, rig in frames:
        owner = points_in_boxes(frame.points, frame.box, 0.05)
        sensor = frame.sensors[0, :2] if len(frame.sensors) == 1 else np.full(2, np.nan)
        for b in np.flatnonzero(frame.number >= 0):
            mine = (owner == b) & (frame.points[:, 2] > _FOOT_M)
            if mine.sum() >= _LEAST_POINTS:
                one = (frame.box[b], sensor, frame.points[mine], frame.ring[mine],
                       frame.semantic[mine])  # fmt: skip
                found.setdefault((int(frame.number[b]), rig), []).append(one)
    rows: list[tuple[NDArray[np.float64], ...]] = []
    keys: list[tuple[int, int]] = []
    for key in sorted(found):
        some = found[key]
        for k in np.unique(np.linspace(0, len(some) - 1, _MOST_OBJECTS).astype(int)):
            rows.append(some[k])
            keys.append(key)
    if not rows:
        nothing = np.zeros((0, 7))
        whole = np.zeros(0, np.int64)
        return ObjectBank(nothing, whole, whole, np.zeros((0, 2)), np.zeros(1, np.int64),
                          np.zeros((0, 3), np.float32), np.zeros(0, np.int32),
                          np.zeros(0, np.uint8))  # fmt: skip
    sizes = [len(one[2]) for one in rows]
    return ObjectBank(
        np.stack([one[0] for one in rows]),
        np.array([number for number, _ in keys]),
        np.array([rig for _, rig in keys]),
        np.stack([one[1] for one in rows]),
        np.concatenate([[0], np.cumsum(sizes)]),
        np.concatenate([one[2] for one in rows]).astype(np.float32),
        np.concatenate([one[3] for one in rows]).astype(np.int32),
        np.concatenate([one[4] for one in rows]).astype(np.uint8),
    )


def write_bank(path: Path, bank: ObjectBank) -> None:
    """Write a bank as an uncompressed npz archive."""
    with path.open("wb") as file:
        np.savez(file, **{one.name: getattr(bank, one.name) for one in fields(bank)})


def read_bank(path: Path) -> ObjectBank:
    """Read a bank that `write_bank` wrote."""
    with np.load(path) as arrays:
        return ObjectBank(**{one.name: arrays[one.name] for one in fields(ObjectBank)})


def pasted(
    frame: LevelFrame,
    bank: ObjectBank,
    rig: int,
    classes: Sequence[str],
    window: tuple[float, float, float],
    draw: np.random.Generator,
) -> LevelFrame:
    """Paste objects of other frames into a frame.

    Args:
        frame: frame to paste into.
        bank: objects.
        rig: index of the frame's recording.
        classes: names of the classes, in order.
        window: x, y and half the edge of the area of pasted objects, metres.
        draw: random generator.
    """
    for number, name in enumerate(classes):
        some = np.flatnonzero((bank.number == number) & (bank.rig == rig))
        for _ in range(int(draw.poisson(PASTED.get(name, 1.0)))):
            if len(some):
                frame = _with_one(frame, bank, int(draw.choice(some)), window, draw)
    return frame


def _with_one(
    frame: LevelFrame,
    bank: ObjectBank,
    k: int,
    window: tuple[float, float, float],
    draw: np.random.Generator,
) -> LevelFrame:
    rows = slice(bank.first[k], bank.first[k + 1])
    points, box = bank.points[rows], bank.box[k]
    if len(frame.sensors) == 1:
        about, here = bank.sensor[k], frame.sensors[0, :2]
        turn = Placement(about[0], about[1], draw.uniform(-np.pi, np.pi))
        box = turn.boxes(box[None])[0] + [*here, 0, 0, 0, 0, 0]
        points = turn.points(points) + np.array([*here, *[0] * (points.shape[1] - 2)], np.float32)
    x, y, half = window
    if max(abs(box[0] - x), abs(box[1] - y)) > half or _is_taken(frame, box):
        return frame
    hides, hidden = _shadows(frame, points, bank.ring[rows])
    seen = ~hidden
    if seen.sum() < _LEAST_POINTS:
        return frame
    stays = ~hides
    return replace(
        frame,
        points=np.concatenate([frame.points[stays], points[seen].astype(np.float32)]),
        ring=np.concatenate([frame.ring[stays], bank.ring[rows][seen]]),
        semantic=np.concatenate([frame.semantic[stays], bank.semantic[rows][seen]]),
        box=np.concatenate([frame.box, box[None]]),
        number=np.concatenate([frame.number, bank.number[k : k + 1]]),
    )


def _is_taken(frame: LevelFrame, box: NDArray[np.float64]) -> bool:
    """Return whether a box would overlap another box or points of the scene."""
    reach = np.hypot(box[3], box[4]) / 2 + _BESIDE_M
    others = frame.box
    near = np.hypot(*(others[:, :2] - box[:2]).T) < reach + np.hypot(*others[:, 3:5].T) / 2
    if any(_overlap(box, other) for other in others[near]):
        return True
    x, y = frame.points[:, 0], frame.points[:, 1]
    close = np.flatnonzero((np.abs(x - box[0]) < reach) & (np.abs(y - box[1]) < reach))
    inside = points_in_boxes(frame.points[close], box[None], _BESIDE_M) == 0
    return bool((inside & (frame.points[close, 2] > _TAKEN_M)).sum() >= _TAKEN_POINTS)


def _overlap(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two boxes overlap in plan (separating axis theorem)."""
    for axis in (one[6], one[6] + np.pi / 2, other[6], other[6] + np.pi / 2):
        along = np.array([np.cos(axis), np.sin(axis)])
        reach = sum(
            abs(np.cos(axis - box[6])) * box[3] / 2 + abs(np.sin(axis - box[6])) * box[4] / 2
            for box in (one, other)
        )
        if abs(float((one[:2] - other[:2]) @ along)) > reach + _BESIDE_M:
            return False
    return True


def _shadows(
    frame: LevelFrame, points: NDArray[np.float32], ring: NDArray[np.int32]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which points of the frame the object hides, and which of its own are hidden."""
    hides = np.zeros(len(frame.points), bool)
    hidden = np.zeros(len(points), bool)
    several = len(frame.sensors) > 1
    for sensor, place in enumerate(frame.sensors):
        mine = ring // RINGS == sensor if several else np.ones(len(points), bool)
        if not mine.any():
            continue
        theirs = np.flatnonzero(frame.ring // RINGS == sensor) if several else None
        scene = frame.points if theirs is None else frame.points[theirs]
        name, range_m = _directions(points[mine], place)
        here = _within(scene, place, points[mine])
        other, away = _directions(scene[here], place)
        cells, inverse = np.unique(name, return_inverse=True)
        farthest = np.zeros(len(cells))
        np.maximum.at(farthest, inverse, range_m)
        at = np.minimum(np.searchsorted(cells, other), len(cells) - 1)
        same = cells[at] == other
        behind = same & (away > farthest[at] + _BEHIND_M)
        rows = here if theirs is None else theirs[here]
        hides[rows[behind]] = True
        nearest = np.full(len(cells), np.inf)
        np.minimum.at(nearest, at[same], away[same])
        hidden[mine] = nearest[inverse] < range_m - _BEHIND_M
    return hides, hidden


def _directions(
    points: NDArray[np.floating], place: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the direction index (N,) and the range (N,) of points from a sensor."""
    away = points[:, :3] - place
    flat = np.hypot(away[:, 0], away[:, 1])
    around = np.floor(np.degrees(np.arctan2(away[:, 1], away[:, 0])) / _AROUND_DEG)
    up = np.floor(np.degrees(np.arctan2(away[:, 2], flat)) / _UP_DEG)
    name = (around.astype(np.int64) + 10_000) * 10_000 + up.astype(np.int64) + 5_000
    return name, np.hypot(flat, away[:, 2])


def _within(
    scene: NDArray[np.float32], place: NDArray[np.float64], points: NDArray[np.floating]
) -> NDArray[np.int64]:
    """Return the rows of the scene's points within the sector of an object."""
    middle = points[:, :2].mean(axis=0) - place[:2]
    far = float(np.hypot(*middle))
    wide = float(np.hypot(*(points[:, :2] - place[:2] - middle).T).max()) + 0.5
    if far < 2 * wide:
        return np.arange(len(scene))
    along = middle / far
    x, y = scene[:, 0] - place[0], scene[:, 1] - place[1]
    ahead = x * along[0] + y * along[1]
    aside = np.abs(y * along[0] - x * along[1])
    return np.flatnonzero(aside < ahead * (wide / (far - wide)))
