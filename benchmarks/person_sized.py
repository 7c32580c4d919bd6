"""How many things as large as a person stand in streets, real and simulated: notebook/learning.md.

    python benchmarks/person_sized.py DATASET ...       # datasets of `record` by a sensor on a car
    python benchmarks/person_sized.py PLACE/twin ...    # twins, without actors, by an HDL-64E

Groups of points 0.4 to 1.9 m above the ground that are in no labelled box, per 1,000 m2 within
40 m: of KITTI's odd and even frames (what the camera saw), of the datasets, and of the same with
what `train` sets into samples. Of twins, the built scene alone as an HDL-64E sees it from four
places on lanes.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import find_objects, label

from beside_streets import above_ground, scans
from urbantwin.fidelity.readers import open_recording
from urbantwin.learn.augmentation import cluttered
from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.frames import LevelFrame, level_frame_from

KITTI = Path(__file__).parents[1].parent / "shared/data/recordings/kitti-training"
CLASSES = ("car", "bicycle", "pedestrian")
#: Edge of the cells that points are grouped by, metres; points of a group; where it begins.
CELL_M, FEWEST, LOWEST_M = 0.25, 8, 1.0
#: Slim ones are so wide at most, and all; tall ones reach so high, low ones at least, metres.
SLIM_M, WIDEST_M, TALL_M, LOW_M = 0.5, 1.25, 1.1, 0.8
NEAR_M, FAR_M, REACH_M = 3.0, 40.0, 60.0
#: Half of what is looked at in KITTI's view, degrees; half of a sample's window, metres.
HALF_DEG, HALF_M = 40.0, 25.6

Places = NDArray[np.floating]
Where = Callable[[Places], NDArray[np.bool_]]


class Levelled(Protocol):
    """Points on level ground, and boxes."""

    points: NDArray[np.float32]
    box: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Bare:
    """A frame of the built scene alone."""

    points: NDArray[np.float32]
    box: NDArray[np.float64]


def bare_frames(twin: Path) -> Iterator[Bare]:
    """Frames of a twin without actors, of an HDL-64E on lanes."""
    for points, _ in scans(twin, "kitti"):
        kept = points[np.hypot(points[:, 0], points[:, 1]) < FAR_M + 5]
        high = np.column_stack([kept[:, :2], above_ground(kept)])
        yield Bare(high.astype(np.float32), np.zeros((0, 7)))


def counted(frame: Levelled, where: Where) -> NDArray[np.float64]:
    """How many slim, wide and low things there are where it is asked, per 1,000 m2."""
    along = np.arange(-FAR_M, FAR_M) + 0.5
    area = where(np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)).sum() / 1000
    points = frame.points[where(frame.points)]
    points = points[(points[:, 2] > 0.4) & (points[:, 2] < 1.9)]
    points = points[points_in_boxes(points, frame.box, 0.1) < 0]
    cell = np.floor((points[:, :2] + REACH_M) / CELL_M).astype(int)
    taken = np.zeros((round(2 * REACH_M / CELL_M),) * 2, bool)
    taken[tuple(cell.T)] = True
    group, _ = label(taken, np.ones((3, 3)))
    mine = group[tuple(cell.T)]
    found = np.zeros(3)
    for number, sides in enumerate(find_objects(group), 1):
        z = points[mine == number, 2]
        wide = max(side.stop - side.start for side in sides) * CELL_M
        if wide > WIDEST_M or len(z) < FEWEST or z.min() > LOWEST_M:
            continue
        if z.max() > TALL_M:
            found[0 if wide <= SLIM_M else 1] += 1
        elif z.max() > LOW_M:
            found[2] += 1
    return np.asarray(found / max(area, 1e-9))


def near(places: Places) -> NDArray[np.bool_]:
    """Whether places are within what is looked at."""
    away = np.hypot(places[:, 0], places[:, 1])
    return np.asarray((away > NEAR_M) & (away < FAR_M))


def in_view(places: Places) -> NDArray[np.bool_]:
    """Whether KITTI's camera saw them."""
    return near(places) & (np.abs(np.degrees(np.arctan2(places[:, 1], places[:, 0]))) < HALF_DEG)


def frames_of(folder: Path, numbers: slice) -> Iterator[LevelFrame]:
    """Frames of a recording on level ground."""
    recording = open_recording(folder)
    for number in range(len(recording))[numbers]:
        yield level_frame_from(recording.read(number), CLASSES, REACH_M, file=folder)


def told(name: str, found: list[NDArray[np.float64]]) -> None:
    """Print a row."""
    slim, wide, low = np.mean(found, axis=0)
    print(f"{name}: {slim:.2f} slim, {wide:.2f} wide, {low:.2f} low ({len(found)} frames)")


def main() -> None:
    """Count."""
    for name, first in (("KITTI, odd", 1), ("KITTI, even", 0)):
        told(name, [counted(one, in_view) for one in frames_of(KITTI, slice(first, None, 2))])
    draw = np.random.default_rng(1)
    bare, full, built = [], [], []
    for folder in sys.argv[1:]:
        if (Path(folder) / "twin.json").exists():
            built += [counted(frame, near) for frame in bare_frames(Path(folder))]
            continue
        for frame in frames_of(Path(folder), slice(0, None, 8)):
            x, y = draw.uniform(-25, 25, 2)

            def window(places: Places, x: float = x, y: float = y) -> NDArray[np.bool_]:
                aside = np.maximum(np.abs(places[:, 0] - x), np.abs(places[:, 1] - y))
                return np.asarray(near(places) & (aside < HALF_M))

            bare.append(counted(frame, window))
            full += [counted(cluttered(frame, (x, y, HALF_M), draw), window) for _ in range(3)]
    if built:
        told("twins without actors", built)
    if bare:
        told("twins", bare)
        told("twins as train sees them", full)


if __name__ == "__main__":
    main()
