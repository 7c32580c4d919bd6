"""Comparison of real and synthetic frames of the same place, as a report."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.errors import InputError, UrbanTwinError
from urbantwin.fidelity.findings import Findings, report_of
from urbantwin.fidelity.pairs import MOST_ANCHORS, Pairs, measured_pairs
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.recording import cropped_recording
from urbantwin.fidelity.report import Report
from urbantwin.fidelity.sides import (
    ANCHOR,
    LABELS,
    MODEL,
    Side,
    model_background,
    open_side,
    survey,
)
from urbantwin.progress import Progress, untold

__all__ = ["compare"]


#: Progress after every frame was read once, and after the arbitrary site was recorded.
_SURVEY, _CONTROL = 0.1, 0.15
#: Temporary folder of the arbitrary site; not part of the report.
_CONTROL_FOLDER = "arbitrary"
#: Number of worst pairs that are drawn.
_WORST = 3


def compare(  # noqa: PLR0913 - every argument is a user's choice
    real: Path,
    synthetic: Path,
    out: Path,
    *,
    arbitrary: Path | Literal["example"] | None = "example",
    anchor: Path | None = None,
    within: ArrayLike | None = None,
    columns: int | None = None,
    layout: str | None = None,
    origin: ArrayLike | None = None,
    protocol: str | None = None,
    detections: Path | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Report:
    """Compare two recordings in the same frame and write the report.

    Writes ``report.json``, a self-contained ``report.html`` and its pictures. Frames are paired in
    the order of their names (numbers by value): the i-th real with the i-th synthetic one. Surplus
    frames of the longer recording are left out, and the report says so; pairs with an unreadable
    frame are left out.

    Args:
        real: a recording of real frames in any layout of ``readers``.
        synthetic: one of our datasets, or another recording of the same place.
        out: folder of the report; an older report there is replaced.
        arbitrary: synthetic frames of another place, as a control. ``example``: an example site,
            recorded by the twin's sensors (`arbitrary.arbitrary_recording`); ``None``: no control.
        anchor: real frames of the same place and sensors at another time, for real against real:
            the reference for a twin made from ``real``. By default each real frame is compared with
            its neighbour, which has nearly the same traffic.
        within: (3,) half extents of a crop about the frame's origin, metres, applied to all sides
            in the frame of the real data.
        columns: values per row of ``.bin`` files, if neither 4 nor 3.
        layout: layout of the real frames, if their files do not show it.
        origin: (3,) position of the sensor in the frame of the points, metres, for ranges and the
            rebuilt surface; by default that of the first readable real frame.
        protocol: a challenge's protocol to compute as well: ``urbantwin-challenge``.
        detections: a detector's detections in the real frames, for the protocol.
        workers: number of processes; the output does not depend on it. By default one per
            processor, or this process alone if there is little to do.
        progress: called with the fraction done and the current step.

    Raises:
        InputError: a recording is invalid, no pair can be read, or ``out`` holds other files.
        StageError: a worker was killed.
    """
    tell = progress or untold
    if protocol is not None:
        from urbantwin.fidelity.challenge import check_protocol

        check_protocol(protocol)
    control = arbitrary if isinstance(arbitrary, Path) else None
    inputs = [real, synthetic, control, anchor, detections]
    opened = _Openers(columns, layout, None if within is None else _extents(within))
    with replaced_folder(out, kind="report", inputs=inputs) as folder:
        sides, lacking = _opened(real, synthetic, arbitrary, anchor, opened, folder, tell)
        split_by = _split(sides)
        ground = None
        if split_by == MODEL:
            from urbantwin.fidelity.foreground_objects import ground_beneath

            ground = ground_beneath(sides["real"])
        pairs = Pairs(sides, _origin(sides["real"], origin), split_by, ground)
        found = _measured(pairs, workers, tell)
        scored = None
        if protocol is not None:
            tell(0.95, "computing the protocol")
            from urbantwin.fidelity.challenge import score_sides

            scored = score_sides(sides, detections)
        report = report_of(found, scored)
        report.notes.extend(lacking)
        write_json(folder / "report.json", report.as_json())
        tell(0.98, "drawing the report")
        _draw(report, found, folder)
        shutil.rmtree(folder / _CONTROL_FOLDER, ignore_errors=True)
    tell(1.0, "compared")
    return report


def _draw(report: Report, found: Findings, folder: Path) -> None:
    """Write the pictures and the page."""
    from urbantwin.fidelity.pair_figure import draw_missing, draw_objects, draw_pair
    from urbantwin.fidelity.report_figure import draw_report
    from urbantwin.fidelity.report_page import Pictures, write_report

    origin = found.pairs.origin
    draw_report(report, found.pooled, folder / "report.png")
    missing = None
    if report.missing:
        missing = folder / "missing.png"
        draw_missing(found.sample["real"], found.missing.points(), report.missing, origin, missing)
    worst: dict[int, Path] = {}
    for number in report.worst()[:_WORST]:
        frames = found.pairs.frames(found.indices[number])
        worst[number] = folder / f"worst_{len(worst) + 1}.png"
        draw_pair(frames["real"], frames["synthetic"], origin, worst[number])
    objects = None
    if report.objects is not None:
        objects = folder / "objects.png"
        draw_objects(report.objects, objects)
    write_report(
        report, Pictures(folder / "report.png", missing, worst, objects), folder / "report.html"
    )


@dataclass(frozen=True)
class _Openers:
    """Options with which recordings are opened."""

    columns: int | None
    layout: str | None
    within: tuple[float, ...] | None

    def open(self, name: str, path: Path) -> Recording:
        real = name in ("real", ANCHOR)
        return self.cropped(open_side(name, path, self.columns, self.layout if real else None))

    def cropped(self, recording: Recording) -> Recording:
        return recording if self.within is None else cropped_recording(recording, self.within)


def _extents(within: ArrayLike) -> tuple[float, ...]:
    half = np.asarray(within, np.float64).ravel()
    if half.shape != (3,) or not ((half > 0) & (half < np.inf)).all():
        raise InputError(
            f"{' '.join(f'{one:g}' for one in half)} are no half extents",
            place="within",
            expected="x, y and z in metres, all above 0",
        )
    return tuple(half.tolist())


def _opened(
    real: Path,
    synthetic: Path,
    arbitrary: Path | Literal["example"] | None,
    anchor: Path | None,
    opened: _Openers,
    scratch: Path,
    tell: Progress,
) -> tuple[dict[str, Side], list[str]]:
    """Open the sides and read every frame to compare once; return the sides and what is missing."""
    recordings = {
        "real": opened.open("real", real),
        "synthetic": opened.open("synthetic", synthetic),
    }
    if isinstance(arbitrary, Path):
        recordings["arbitrary"] = opened.open("arbitrary", arbitrary)
    if anchor is not None:
        recordings[ANCHOR] = opened.open(ANCHOR, anchor)
    pairs = min(len(recordings["real"]), len(recordings["synthetic"]))
    # One more real frame than pairs: the last pair's neighbour.
    used = {"real": pairs + 1, "synthetic": pairs, "arbitrary": MOST_ANCHORS, ANCHOR: pairs}
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
    bad = sides["real"].problems.keys() | sides["synthetic"].problems.keys()
    if bad >= set(range(pairs)):
        raise InputError(
            "no pair of frames can be read on both sides",
            file=real,
            expected=f"frames beside those of {synthetic.name}",
        )
    lacking: list[str] = []
    if arbitrary == "example":
        from urbantwin.fidelity.arbitrary import arbitrary_recording

        try:
            recording = arbitrary_recording(
                recordings["synthetic"],
                min(pairs, MOST_ANCHORS),
                scratch / _CONTROL_FOLDER,
                lambda share, what: tell(_SURVEY + (_CONTROL - _SURVEY) * share, what),
            )
        except UrbanTwinError as error:  # the twin is measured without a control
            lacking.append(f"There is no arbitrary site: {error}.")
        else:
            recording = opened.cropped(recording)
            sides["arbitrary"] = Side("arbitrary", recording, min(len(recording), pairs))
            survey(sides["arbitrary"], lambda: None)
    return sides, lacking


def _origin(real: Side, given: ArrayLike | None) -> NDArray[np.float64]:
    if given is not None:
        place = np.asarray(given, np.float64).reshape(3)
        if not (np.abs(place) < 1e7).all():  # nor NaN
            raise InputError(
                f"{' '.join(f'{one:g}' for one in place)} is not a point",
                place="origin",
                expected="x, y and z in metres in the frame of the clouds",
            )
        return place
    first = next(i for i in range(real.count) if i not in real.problems)
    return np.asarray(real.recording.read(first).sensor_places[0], np.float64)


def _split(sides: dict[str, Side]) -> str | None:
    """Return how foreground and background are separated on both sides."""
    pair = (sides["real"], sides["synthetic"])
    if all(side.labelled for side in pair):
        return LABELS
    modelled = [model_background(side) for side in pair]
    if all(modelled):
        for name in ("arbitrary", ANCHOR):
            if name in sides:
                model_background(sides[name])
        return MODEL
    return None


def _measured(pairs: Pairs, workers: int | None, tell: Progress) -> Findings:
    """Return the findings of all pairs."""
    found = Findings(pairs)
    for index, one in enumerate(measured_pairs(pairs, workers)):
        if one is not None:
            found.add(one)
        done = (index + 1) / len(pairs)
        tell(_CONTROL + (0.95 - _CONTROL) * done, f"compared {index + 1} of {len(pairs)} pairs")
    return found
