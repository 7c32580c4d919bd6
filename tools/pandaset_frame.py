"""The PandaSet frame as rays of its Pandar64: rings, and the vehicle's motion undone.

The file has the points of a turn in the order of their firing, moved to one time, in the vehicle's
frame, and neither rings nor where the sensor was. Where it was and how it moved is what lets the
points lie on the channels of the catalogue's Pandar64: place, tilt and velocity are fitted to
12,000 points, and points farther than `NEAR_DEG` from any channel are left out.

    python tools/pandaset_frame.py pandaset/        # a folder that every command reads
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution, minimize

from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers.labels import actor_class
from urbantwin.geometry import Pose
from urbantwin.lidar import sensor

FILE = Path(__file__).parents[1].parent / "shared/data/recordings/pandaset-001/frame_ego.npz"
NEAR_DEG = 0.08
#: x, y, z, pitch, roll, and how far it moves in a turn.
_BOUNDS = [
    (-0.6, 0.6), (-0.5, 1.5), (1.4, 2.3), (-0.03, 0.03), (-0.03, 0.03),
    (-0.3, 0.3), (-2.0, 2.0), (-0.1, 0.1),
]  # fmt: skip


def _seen(points: np.ndarray, part: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Points (N, 3) in the sensor's frame; part is when of the turn, -0.5 to 0.5."""
    tilt = Pose.from_ypr(np.zeros(3), 0.0, x[3], x[4]).rotation
    return np.asarray((points - x[:3] - part[:, None] * x[5:8]) @ tilt)


def _off(seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The nearest channel (N,) of points and how far off its elevation they are, degrees."""
    table = sensor("Pandar64").elevation_deg
    order = np.argsort(table)
    sorted_ = table[order]
    up = np.degrees(np.arctan2(seen[:, 2], np.hypot(seen[:, 0], seen[:, 1])))
    above = np.clip(np.searchsorted(sorted_, up), 1, len(sorted_) - 1)
    low = np.abs(up - sorted_[above - 1]) < np.abs(up - sorted_[above])
    nearest = np.where(low, above - 1, above)
    return order[nearest], np.abs(up - sorted_[nearest])


@cache
def pandaset_frame(file: Path = FILE) -> Frame:
    """The frame in the sensor's own frame, with rings, labels and codes of 0 to 255."""
    given = np.load(file)
    turning = given["device"] == 0
    points = given["xyz"][turning].astype(np.float64)
    part = np.arange(len(points)) / len(points) - 0.5
    away = np.linalg.norm(points, axis=1)
    near = np.flatnonzero((away > 4) & (away < 40))
    some = np.random.default_rng(0).choice(near, 12_000, replace=False)

    def misfit(x: np.ndarray, width_deg: float) -> float:
        off = _off(_seen(points[some], part[some], x))[1]
        return float(1 - np.exp(-((off / width_deg) ** 2)).mean())

    x = differential_evolution(
        misfit, _BOUNDS, args=(0.06,), maxiter=120, popsize=12, seed=1, tol=1e-6
    ).x
    for width_deg in (0.04, 0.03):
        x = minimize(
            misfit, x, args=(width_deg,), method="Nelder-Mead", options={"maxiter": 1500}
        ).x
    seen = _seen(points, part, x)
    ring, off = _off(seen)
    kept = off < NEAR_DEG
    boxes, names = [], []
    for middle, (wide, long, high), yaw, name in zip(
        given["box_center"], given["box_wlh_xyz"], given["box_yaw"], given["box_label"], strict=True
    ):
        there = (np.abs(points - middle) < max(long, wide) / 2).all(axis=1)
        if there.any():
            place = _seen(middle[None], np.array([np.median(part[there])]), x)[0]
            # PandaSet's yaw turns the y axis: lengths lie along it.
            boxes.append([*place, long, wide, high, yaw + np.pi / 2])
            names.append(str(name))
    classes = tuple(actor_class(name) for name in names)
    return Frame(
        seen[kept],
        intensity=given["intensity"][turning][kept].astype(np.float64),
        ring=ring[kept],
        boxes=Boxes(np.array(boxes), classes, np.arange(1, len(boxes) + 1), tuple(names)),
        name="001",
    )


def write_as_openpcdet(frame: Frame, folder: Path) -> None:
    """Write a frame as points and labels of OpenPCDet, ring by ring, each by azimuth."""
    assert frame.ring is not None
    assert frame.intensity is not None
    assert frame.boxes is not None
    for name in ("points", "labels"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    azimuth = np.arctan2(frame.points[:, 1], frame.points[:, 0]) % (2 * np.pi)
    order = np.lexsort([azimuth, frame.ring])
    rows = np.column_stack([frame.points, frame.intensity])[order]
    np.save(folder / "points" / f"{frame.name}.npy", rows.astype(np.float32))
    called = (name.replace(" ", "") for name in frame.boxes.source_names)
    lines = (
        " ".join([*(f"{value:.4f}" for value in box), name])
        for box, name in zip(frame.boxes.box, called, strict=True)
    )
    (folder / "labels" / f"{frame.name}.txt").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    write_as_openpcdet(pandaset_frame(), Path(sys.argv[1]))
