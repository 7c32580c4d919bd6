"""Results of all pairs, combined into a report."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.fidelity import histograms as bins
from urbantwin.fidelity import point_to_mesh
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.measure import BACKGROUND, FOREGROUND
from urbantwin.fidelity.missing import NEAR_M, SPACING_SHARE, MissingPlaces
from urbantwin.fidelity.object_statistics import object_differences
from urbantwin.fidelity.pairs import MeasuredPair, Pairs
from urbantwin.fidelity.point_to_mesh import MAX_POINTS
from urbantwin.fidelity.report import Anchored, FrameFigures, Report, anchored
from urbantwin.fidelity.sides import ANCHOR, Side

__all__ = ["Findings", "report_of"]


@dataclass(eq=False)
class Findings:
    """Collects the results of pairs.

    Attributes:
        pairs: the pairs to measure.
        frames: values of each measured pair.
        indices: indices of the measured pairs.
        pooled: histograms summed over pairs, by side and name.
        sample: frames of the first pair, by side.
        missing: places of real points without a surface of the twin nearby.
        objects: foreground objects (K, 6) in each frame, by side.
    """

    pairs: Pairs
    frames: list[FrameFigures] = field(default_factory=list)
    indices: list[int] = field(default_factory=list)
    pooled: dict[str, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    sample: dict[str, Frame] = field(default_factory=dict)
    missing: MissingPlaces = field(default_factory=MissingPlaces)
    objects: dict[str, list[NDArray[np.float64]]] = field(default_factory=dict)

    def add(self, one: MeasuredPair) -> None:
        """Add a pair; pairs are added in their order."""
        self.frames.append(one.figures)
        self.indices.append(one.index)
        self.sample = self.sample or self.pairs.frames(one.index)
        for side, histograms in one.binned.items():
            mine = self.pooled.setdefault(side, {})
            for name, counts in histograms.items():
                mine[name] = mine.get(name, np.zeros_like(counts)) + counts
        self.missing.add(one.missing)
        for side, rows in one.objects.items():
            self.objects.setdefault(side, []).append(rows)


def report_of(found: Findings, scored: dict[str, Any] | None = None) -> Report:
    """Return the report of the results, with the scores of a challenge's protocol if given."""
    from urbantwin.fidelity.consistency import doubts_about

    sides, split_by, frames = found.pairs.sides, found.pairs.split_by, found.frames
    doubts = doubts_about(found.sample["real"], found.sample["synthetic"])
    parts = {part: _part(frames, part) for part in (FOREGROUND, BACKGROUND)}
    return Report(
        folders={
            name: {
                "name": side.recording.path.resolve().name,
                "layout": side.recording.layout,
                "clouds": len(side.recording),
                "compared": side.count
                if name == ANCHOR
                else sum(name in frame.points for frame in frames),
                "intensity_full_scale": side.scale,
            }
            for name, side in sides.items()
        },
        frames=frames,
        whole=anchored(
            [frame.twin_figures for frame in frames],
            [frame.arbitrary_figures for frame in frames],
            [frame.real_figures for frame in frames],
        ),
        parts={part: one for part, one in parts.items() if one is not None},
        split_by=split_by,
        objects=_objects(sides),
        foreground_objects=_foreground_objects(found),
        missing=found.missing.places(),
        parameters=_parameters(found.pairs.origin),
        notes=_notes(found, doubts),
        doubts=doubts,
        problems=[
            f"{name}: {side.recording.names[index]}: {why}"
            for name, side in sides.items()
            for index, why in side.problems.items()
        ],
        protocol=scored,
    )


def _foreground_objects(found: Findings) -> dict[str, Any] | None:
    if not found.objects:
        return None
    from urbantwin.fidelity.foreground_objects import foreground_objects

    return foreground_objects(found.objects)


def _part(frames: list[FrameFigures], part: str) -> Anchored | None:
    rows = [frame.parts.get(part, {}) for frame in frames]
    if not any("twin" in row for row in rows):
        return None
    return anchored(*([row.get(side) for row in rows] for side in ("twin", "arbitrary", "real")))


def _objects(sides: dict[str, Side]) -> dict[str, Any] | None:
    """Return object statistics by side, and their differences; None without real labels."""
    told = {name: side.objects for name, side in sides.items() if side.objects.frames}
    if "real" not in told:
        return None
    found: dict[str, Any] = {name: one.as_json() for name, one in told.items()}
    for name in ("synthetic", "arbitrary"):
        if name in told:
            found[f"{name}_against_real"] = object_differences(told["real"], told[name])
    return found


def _parameters(origin: NDArray[np.float64]) -> dict[str, Any]:
    return {
        "origin_m": origin.tolist(),
        "voxel_m": bins.VOXEL_M,
        "bins": {
            "range_m": _bins(bins.RANGE_EDGES_M),
            "height_m": _bins(bins.HEIGHT_EDGES_M),
            "intensity": _bins(bins.INTENSITY_EDGES),
            "density_m": _bins(bins.DENSITY_EDGES_M),
        },
        "surface": {
            "max_edge_m": point_to_mesh.MAX_EDGE_M,
            "max_angle_deg": point_to_mesh.MAX_ANGLE_DEG,
            "min_grazing_deg": point_to_mesh.MIN_GRAZING_DEG,
            "level_deg": point_to_mesh.LEVEL_DEG,
            "max_points": MAX_POINTS,
        },
        "missing": {"farther_than_m": NEAR_M, "or_share_of_range": SPACING_SHARE},
    }


def _bins(edges: NDArray[np.float64]) -> dict[str, Any]:
    return {"from": float(edges[0]), "to": float(edges[-1]), "count": len(edges) - 1}


def _notes(found: Findings, doubts: list[str]) -> list[str]:
    """Return the notes about the input that qualify the values."""
    sides, split_by, frames = found.pairs.sides, found.pairs.split_by, found.frames
    pairs, anchors = len(found.pairs), len(found.pairs.anchors)
    notes = ["Frames are paired in the order of their names: the i-th with the i-th."]
    notes += doubts
    notes.append(
        f"Foreground and background are separated by {split_by}."
        if split_by
        else "Foreground and background are not separated: labels are not on both sides, and "
        "there are too few frames of a sensor that stands still."
    )
    for name, side in sides.items():
        more = len(side.recording) - (anchors if name == "arbitrary" else pairs)
        if name in ("arbitrary", ANCHOR) and more > 0:
            continue
        if more > 0:
            notes.append(f"{name}: {more} further clouds have no partner.")
        elif more < 0:
            notes.append(f"{name}: only {len(side.recording)} clouds for {pairs} pairs.")
        if side.problems:
            notes.append(f"{name}: {len(side.problems)} frames cannot be read (see problems).")
        for reason, text in (
            ("not_finite", "points with a NaN or infinite value"),
            ("no_return", "points at exactly (0, 0, 0), beams without a return,"),
        ):
            lost = sum(frame.points.get(name, {}).get(reason, 0) for frame in frames)
            if lost:
                notes.append(f"{name}: {lost} {text} are left out.")
        if side.scale is None:
            notes.append(f"{name}: has no intensity in every cloud: it is not compared.")
        notes += [f"{name}: {note}" for note in side.recording.notes]
        shown = found.sample.get(name)
        notes += [f"{name}: {note}" for note in (shown.notes if shown else ())]
    if pairs > anchors:
        notes.append(f"Both anchors are measured at {anchors} pairs, spread evenly.")
    if ANCHOR in sides:
        notes.append(
            "Real against real is between the real frames and those of "
            f"{sides[ANCHOR].recording.path.name}, not between neighbours."
        )
    elif len(sides["real"].recording) < 2:
        notes.append("A single real frame: there is no real against real.")
    return notes
