"""Two sides with one camera: paired frames, distances between them, and worst places."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact import read_json
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.nearest_point import PointTree
from urbantwin.geometry import Pose
from urbantwin.web.side import FrameEntry

__all__ = [
    "away_from",
    "farthest_place",
    "pairs_of_sides",
    "read_report",
    "sides_of_report",
    "worst_places",
]

#: Places with missing points, and pairs, that are listed of a report.
_MOST_MISSING, _MOST_PAIRS = 20, 5
#: Cell size in the search for the worst place of a pair, metres.
_CELL_M = 4.0


def pairs_of_sides(
    first: list[FrameEntry], second: list[FrameEntry], *, same_clock: bool
) -> list[tuple[int, int]]:
    """Return indices of paired frames.

    Frames are paired by equal names and, for two datasets of one clock, equal times; otherwise by
    number, as ``compare`` pairs them.

    Args:
        first: frames of one side.
        second: frames of the other side.
        same_clock: whether their times are of one clock.
    """
    names = {entry.name: index for index, entry in enumerate(second)}
    if len(names) == len(second):
        shared = [
            (index, names[entry.name])
            for index, entry in enumerate(first)
            if entry.name in names
            and (not same_clock or abs(entry.time_s - second[names[entry.name]].time_s) < 1e-6)
        ]
        if shared and all(a[1] < b[1] for a, b in pairwise(shared)):
            return shared
    if same_clock:
        times = np.array([entry.time_s for entry in second])
        nearest = [int(np.abs(times - entry.time_s).argmin()) for entry in first]
        found = [
            (index, other)
            for index, other in enumerate(nearest)
            if abs(times[other] - first[index].time_s) < 1e-6
        ]
        if found:
            return found
    return [(index, index) for index in range(min(len(first), len(second)))]


def away_from(frame: Frame, other: Frame) -> NDArray[np.float64]:
    """Return the distance (N,) of each point of a frame to the nearest of another, metres."""
    return PointTree(frame.points).nearest_of(PointTree(other.points))[0]


def read_report(folder: Path) -> dict[str, Any]:
    """Return a report of ``urbantwin compare``.

    Raises:
        InputError: it is none.
    """
    report = read_json(folder / "report.json", kind="report")
    folders = report.get("folders")
    if not isinstance(folders, Mapping) or not isinstance(report.get("frames"), list):
        raise InputError(
            "says not what was compared",
            file=folder / "report.json",
            expected="a report of urbantwin compare",
        )
    return report


def sides_of_report(folder: Path, report: Mapping[str, Any]) -> tuple[Path, Path]:
    """Return the two sides of a report, searched by name beside it and in the current folder.

    Raises:
        InputError: a side is not found.
    """
    found = []
    for side in ("real", "synthetic"):
        name = Path(str((report["folders"].get(side) or {}).get("name") or "")).name
        places = [folder.resolve().parent / name, Path(name), folder.resolve().parents[1] / name]
        place = next((one for one in places if name and one.exists()), None)
        if place is None:
            raise InputError(
                f"was made of {name or 'frames'}, which is not beside it",
                file=folder,
                expected="urbantwin view REAL SYNTHETIC --report REPORT",
            )
        found.append(place)
    return found[0], found[1]


def worst_places(
    report: Mapping[str, Any],
    pairs: list[tuple[int, int]],
    first: list[FrameEntry],
    scene_SE3_points: Pose | None,
    worst_of_pair: Callable[[int, int], NDArray[np.float64] | None],
) -> list[dict[str, Any]]:
    """Return the worst places of a report: missing points, and the worst pairs.

    Args:
        report: report of ``urbantwin compare``.
        pairs: indices of paired frames.
        first: frames of the real side.
        scene_SE3_points: transform from the report's frame to the scene; None for the identity.
        worst_of_pair: returns the worst place of a pair, in the scene; None if unreadable.

    Raises:
        InputError: the report has another form.
    """
    shown = {first[index].name: (index, other) for index, other in pairs}
    rows: list[dict[str, Any]] = []
    ranked: list[tuple[float, str]] = []
    try:
        for place in (report.get("missing") or [])[:_MOST_MISSING]:
            at = np.array([place["x"], place["y"], (place["low"] + place["high"]) / 2], float)
            if not np.isfinite(at).all():
                raise ValueError(at)
            if scene_SE3_points is not None:
                at = scene_SE3_points.apply(at[None])[0]
            text = (
                f"missing in the twin: {float(place['points_per_frame']):.0f} points a frame, "
                f"{float(place['distance_m']):.2f} m from any of its points"
            )
            rows.append(_worst(pairs[0][0] if pairs else 0, text, at))
        for row in report["frames"]:
            figure = (row.get("twin_figures") or {}).get("hausdorff_p95_m")
            if figure is not None and str(row["real"]) in shown:
                ranked.append((-float(figure), str(row["real"])))
    except (KeyError, TypeError, ValueError, AttributeError):
        raise InputError(
            "has figures of another form", expected="a report of urbantwin compare"
        ) from None
    for figure, name in sorted(ranked)[:_MOST_PAIRS]:
        found = worst_of_pair(*shown[name])
        if found is not None:
            text = f"frame {name}: 95 % of the points are within {-figure:.2f} m"
            rows.append(_worst(shown[name][0], text, found))
    return rows


def farthest_place(points: NDArray[np.float64], away: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the place (3,) with the largest summed distance of points from the other side."""
    cell = np.floor(points[:, :2] / _CELL_M).astype(np.int64)
    _, where = np.unique(cell, axis=0, return_inverse=True)
    weight = np.minimum(away, _CELL_M)
    worst = int(np.bincount(where.ravel(), weight).argmax())
    mine = where.ravel() == worst
    return np.asarray(np.average(points[mine], axis=0, weights=weight[mine] + 1e-9))


def _worst(frame: int, text: str, at: NDArray[np.float64]) -> dict[str, Any]:
    return {"frame": frame, "text": text, "at": [round(float(one), 3) for one in at]}
