"""``compare``: real frames against synthetic frames of the same place, as a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.errors import InputError, UrbanTwinError
from urbantwin.fidelity import histograms as bins
from urbantwin.fidelity import surface
from urbantwin.fidelity.consistency import doubts_about
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import Histograms
from urbantwin.fidelity.measure import BACKGROUND, FOREGROUND, Measured, RealFrame
from urbantwin.fidelity.missing import NEAR_M, SPACING_SHARE, MissingPlaces
from urbantwin.fidelity.objects import object_differences
from urbantwin.fidelity.point_to_mesh import MAX_POINTS
from urbantwin.fidelity.report import Anchored, FrameFigures, Report, anchored
from urbantwin.fidelity.sides import LABELS, MODEL, Side, model_background, open_side, survey

__all__ = ["compare"]

Progress = Callable[[float, str], None]

#: Shares of the work after which every frame was read once, and the arbitrary site is there.
_SURVEY, _CONTROL = 0.1, 0.15
#: Anchors are measured at so many pairs, spread evenly, where there are more.
_ANCHORS = 30


@dataclass(eq=False)
class _Found:
    """What is gathered while pairs are measured."""

    frames: list[FrameFigures] = field(default_factory=list)
    pooled: dict[str, dict[str, NDArray[np.float64]]] = field(default_factory=dict)
    sample: dict[str, Frame] = field(default_factory=dict)
    indices: list[int] = field(default_factory=list)
    missing: MissingPlaces = field(default_factory=MissingPlaces)

    def pool(self, side: str, found: Histograms) -> None:
        mine = self.pooled.setdefault(side, {})
        for name, counts in found.binned.items():
            mine[name] = mine.get(name, np.zeros_like(counts)) + counts


def compare(  # noqa: PLR0913 - every one is a person's choice
    real: Path,
    synthetic: Path,
    out: Path,
    *,
    arbitrary: Path | Literal["example"] | None = "example",
    columns: int | None = None,
    layout: str | None = None,
    origin: ArrayLike | None = None,
    protocol: str | None = None,
    detections: Path | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compare two recordings in the same frame and write the report.

    ``report.json``, ``report.html`` (with everything in it) and its pictures are written.
    Frames are paired in the order of their names (numbers by value): the i-th real with the i-th
    synthetic one. The longer recording's further frames are left out, and the report says so; of
    a frame that cannot be read, the pair is left out.

    Args:
        real: a recording of real frames: any layout that ``readers`` knows.
        synthetic: one of our datasets, or another recording of the same place.
        out: the report's folder; an older report there is replaced.
        arbitrary: synthetic frames of some other place: the control that the twin is measured
            beside. ``example``: an example site, recorded by the twin's sensors
            (`arbitrary.arbitrary_recording`); ``None``: no control.
        columns: values per row of ``.bin`` files, where it is neither 4 nor 3.
        layout: of the real frames, where their files do not tell it.
        origin: (3,) the sensor's place in the frame of the points, metres: where ranges and the
            rebuilt surface are seen from. By default where the real frames say that it is.
        protocol: a challenge's protocol to compute as well: ``urbantwin-challenge``.
        detections: what a detector found in the real frames, for the protocol.
        progress: called with the fraction done and what is being done.

    Raises:
        InputError: a recording is not what it should be, no pair can be read, or ``out`` holds
            other files.
    """
    tell = progress or (lambda fraction, what: None)
    if protocol is not None:
        from urbantwin.fidelity.challenge import check_protocol

        check_protocol(protocol)
    with replaced_folder(out, kind="report") as folder:
        sides, lacking = _opened(real, synthetic, arbitrary, columns, layout, tell)
        place = _origin(sides["real"], origin)
        split_by = _split(sides)
        found = _measure(sides, place, split_by, tell)
        scored = None
        if protocol is not None:
            tell(0.95, "computing the protocol")
            from urbantwin.fidelity.challenge import score_sides

            scored = score_sides(sides, detections)
        report = _report(sides, found, place, split_by, scored)
        report.notes.extend(lacking)
        write_json(folder / "report.json", report.as_json())
        tell(0.98, "drawing the report")
        _draw(report, sides, found, place, folder)
    tell(1.0, "compared")
    return report


def _draw(
    report: Report,
    sides: dict[str, Side],
    found: _Found,
    origin: NDArray[np.float64],
    folder: Path,
) -> None:
    """Write the pictures and the page."""
    from urbantwin.fidelity.figure import draw_report
    from urbantwin.fidelity.page import write_page
    from urbantwin.fidelity.views import draw_objects, draw_pair

    draw_report(report, found.pooled, found.sample, folder / "report.png")
    pictures = [("Distributions, and frame by frame", folder / "report.png")]
    worst = found.indices[report.worst()[0]]
    real, twin = sides["real"].read(worst), sides["synthetic"].read(worst)
    if real is not None and twin is not None:
        target = folder / "worst_frame.png"
        draw_pair(real, twin, found.missing.points(), report.missing, origin, target)
        pictures.append(("The worst pair of frames, and what the twin lacks", target))
    if report.objects is not None:
        draw_objects(report.objects, folder / "objects.png")
        pictures.append(("Objects", folder / "objects.png"))
    write_page(report, pictures, folder / "report.html")


def _opened(
    real: Path,
    synthetic: Path,
    arbitrary: Path | Literal["example"] | None,
    columns: int | None,
    layout: str | None,
    tell: Progress,
) -> tuple[dict[str, Side], list[str]]:
    """Open the sides and read every frame that will be compared once; say what is lacking."""
    recordings = {
        "real": open_side("real", real, columns, layout),
        "synthetic": open_side("synthetic", synthetic, columns),
    }
    if isinstance(arbitrary, Path):
        recordings["arbitrary"] = open_side("arbitrary", arbitrary, columns)
    pairs = min(len(recordings["real"]), len(recordings["synthetic"]))
    # One real frame more than pairs: the last one's neighbour.
    used = {"real": pairs + 1, "synthetic": pairs, "arbitrary": _ANCHORS}
    sides = {
        name: Side(name, recording, min(len(recording), used[name]))
        for name, recording in recordings.items()
    }
    total, done = sum(side.count for side in sides.values()), 0

    def step() -> None:
        nonlocal done
        tell(_SURVEY * done / total, "checking the frames")
        done += 1

    for side in sides.values():
        survey(side, step)
    lacking: list[str] = []
    if arbitrary == "example":
        from urbantwin.fidelity.arbitrary import arbitrary_recording

        try:
            recording = arbitrary_recording(
                recordings["synthetic"],
                min(pairs, _ANCHORS),
                lambda share, what: tell(_SURVEY + (_CONTROL - _SURVEY) * share, what),
            )
        except UrbanTwinError as error:  # The twin is measured all the same.
            lacking.append(f"There is no arbitrary site: {error}.")
        else:
            sides["arbitrary"] = Side("arbitrary", recording, min(len(recording), pairs))
            survey(sides["arbitrary"], lambda: None)
    return sides, lacking


def _origin(real: Side, given: ArrayLike | None) -> NDArray[np.float64]:
    if given is not None:
        return np.asarray(given, np.float64).reshape(3)
    first = next(i for i in range(real.count) if i not in real.problems)
    return np.asarray(real.recording.read(first).sensor_places[0], np.float64)


def _split(sides: dict[str, Side]) -> str | None:
    """Return how foreground is told from background, the same way on both sides."""
    pair = (sides["real"], sides["synthetic"])
    if all(side.labelled for side in pair):
        return LABELS
    modelled = [model_background(side) for side in pair]
    if all(modelled):
        if "arbitrary" in sides:
            model_background(sides["arbitrary"])
        return MODEL
    return None


def _measure(
    sides: dict[str, Side], origin: NDArray[np.float64], split_by: str | None, tell: Progress
) -> _Found:
    """Measure every pair; pool what the pictures show."""
    real, synthetic, arbitrary = sides["real"], sides["synthetic"], sides.get("arbitrary")
    pairs = min(real.count, synthetic.count)
    found = _Found()
    spread = np.linspace(0, pairs - 1, min(pairs, _ANCHORS)).round().astype(int).tolist()
    anchors = {index: number for number, index in enumerate(spread)}
    following = real.read(0)
    for index in range(pairs):
        tell(
            _CONTROL + (0.95 - _CONTROL) * index / pairs, f"comparing frame {index + 1} of {pairs}"
        )
        here, following = following, real.read(index + 1)
        twin = synthetic.read(index)
        if here is None or twin is None:
            continue
        actors = real.foreground(here, split_by)
        frame = RealFrame(here, foreground=actors, intensity_scale=real.scale, origin=origin)

        def against(side: Side, other: Frame | None, frame: RealFrame = frame) -> Measured | None:
            if other is None:
                return None
            mask = side.foreground(other, split_by)
            return frame.measure(other, foreground=mask, intensity_scale=side.scale)

        control = arbitrary.read(anchors[index]) if arbitrary and index in anchors else None
        measured = {
            "twin": against(synthetic, twin),
            "arbitrary": None if arbitrary is None else against(arbitrary, control),
            "real": against(real, following) if index in anchors else None,
        }
        shown = {"real": here, "synthetic": twin} | ({"arbitrary": control} if control else {})
        found.pool("real", frame.histograms)
        for side, name in (("synthetic", "twin"), ("arbitrary", "arbitrary")):
            one = measured[name]
            if one is not None:
                found.pool(side, one.histograms)
        if measured["twin"] is not None:
            found.missing.add(here.points, measured["twin"].missing, origin, actors)
        found.sample = found.sample or shown
        found.indices.append(index)
        found.frames.append(_figures(frame, shown, measured))
    if not found.frames:
        raise InputError(
            "no pair of frames can be read on both sides",
            file=real.recording.path,
            expected=f"frames beside those of {synthetic.recording.path.name}",
        )
    return found


def _figures(
    frame: RealFrame, shown: dict[str, Frame], measured: dict[str, Measured | None]
) -> FrameFigures:
    error = frame.surface.rebuild_error
    whole = {name: None if one is None else one.figures for name, one in measured.items()}
    return FrameFigures(
        real=shown["real"].name,
        synthetic=shown["synthetic"].name,
        arbitrary=shown["arbitrary"].name if "arbitrary" in shown else None,
        points={
            side: {
                "compared": len(one.points),
                "not_finite": one.not_finite,
                "no_return": one.no_return,
            }
            for side, one in shown.items()
        },
        twin_figures=whole["twin"] or {},
        arbitrary_figures=whole["arbitrary"],
        real_figures=whole["real"],
        rebuild={
            "triangles": frame.surface.surface.triangles,
            "covered": frame.surface.surface.covered,
            "held_out_mean_m": error.mean if error else None,
            "held_out_median_m": error.median if error else None,
            "held_out_p95_m": error.p95 if error else None,
        },
        parts={
            part: {
                name: one.parts[part]
                for name, one in measured.items()
                if one is not None and part in one.parts
            }
            for part in (FOREGROUND, BACKGROUND)
        },
    )


def _report(
    sides: dict[str, Side],
    found: _Found,
    origin: NDArray[np.float64],
    split_by: str | None,
    scored: dict[str, Any] | None,
) -> Report:
    frames = found.frames
    parts = {part: _part(frames, part) for part in (FOREGROUND, BACKGROUND)}
    return Report(
        folders={
            name: {
                "name": side.recording.path.resolve().name,
                "layout": side.recording.layout,
                "clouds": len(side.recording),
                "compared": sum(name in frame.points for frame in frames),
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
        missing=found.missing.places(),
        parameters=_parameters(origin),
        notes=_notes(sides, found, split_by),
        problems=[
            f"{name}: {side.recording.names[index]}: {why}"
            for name, side in sides.items()
            for index, why in side.problems.items()
        ],
        protocol=scored,
    )


def _part(frames: list[FrameFigures], part: str) -> Anchored | None:
    rows = [frame.parts.get(part, {}) for frame in frames]
    if not any("twin" in row for row in rows):
        return None
    return anchored(*([row.get(side) for row in rows] for side in ("twin", "arbitrary", "real")))


def _objects(sides: dict[str, Side]) -> dict[str, Any] | None:
    """Return statistics of objects by side, and how the twin's differ; None without labels."""
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
            "max_edge_m": surface.MAX_EDGE_M,
            "max_angle_deg": surface.MAX_ANGLE_DEG,
            "min_grazing_deg": surface.MIN_GRAZING_DEG,
            "level_deg": surface.LEVEL_DEG,
            "max_points": MAX_POINTS,
        },
        "missing": {"farther_than_m": NEAR_M, "or_share_of_range": SPACING_SHARE},
    }


def _bins(edges: NDArray[np.float64]) -> dict[str, Any]:
    return {"from": float(edges[0]), "to": float(edges[-1]), "count": len(edges) - 1}


def _notes(sides: dict[str, Side], found: _Found, split_by: str | None) -> list[str]:
    """Say what a reader of the figures must know about the input."""
    frames = found.frames
    pairs = min(sides["real"].count, sides["synthetic"].count)
    notes = ["Frames are paired in the order of their names: the i-th with the i-th."]
    notes += doubts_about(found.sample["real"], found.sample["synthetic"])
    notes.append(
        f"Foreground and background are told apart by {split_by}."
        if split_by
        else "Foreground and background are not told apart: labels are not on both sides, and "
        "there are too few frames of a sensor that stands still."
    )
    for name, side in sides.items():
        more = len(side.recording) - (min(pairs, _ANCHORS) if name == "arbitrary" else pairs)
        if name == "arbitrary" and more > 0:
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
    if pairs > _ANCHORS:
        notes.append(f"Both anchors are measured at {_ANCHORS} pairs, spread evenly.")
    if len(sides["real"].recording) < 2:
        notes.append("A single real frame: there is no real against real.")
    return notes
