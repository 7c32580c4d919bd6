"""The protocol on the sides of a comparison, with and without a fit of moments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.challenge.average_precision import Box, mean_precision
from urbantwin.fidelity.challenge.detections import read_detections
from urbantwin.fidelity.challenge.protocol import (
    CLASSES,
    CROP_M,
    FRAMES,
    LIMITS,
    NAME,
    challenge_class,
    combined_score,
    cropped,
    normalised,
)
from urbantwin.fidelity.challenge.realism import EMD_POINTS, POINTS, SEED, fit_moments, realism
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.sides import ANCHOR, Side

__all__ = ["score_clouds", "score_sides"]

_Clouds = Sequence[NDArray[np.float64]]


def score_clouds(
    real: _Clouds,
    others: Mapping[str, _Clouds],
    precision: float | None = None,
    anchor: _Clouds = (),
) -> dict[str, Any]:
    """Score frames against real ones that nothing was fitted to.

    The first half of the real frames is there to fit to; scored are the frames of the second half
    against the real frames of the same numbers, which the fit never sees: an exact copy differs
    by nothing. Halves, and not every other frame: neighbours in time are nearly the same frame.
    With an anchor that is there to fit to, and every real frame judges.

    Args:
        real: (N, 3) cropped points of each frame, at least one frame.
        others: the same by name ("twin", "arbitrary"); where one has no more frames than the half,
            all of them are scored.
        precision: mean average precision of a detector in the real frames.
        anchor: the same of other real frames of the place.

    Returns:
        Rows by name: of each of ``others``, the same with ``_fitted``, and
        ``real_against_real``: raw components, their scores, and the score.
    """
    half = 0 if anchor else len(real) // 2
    training, held_out = anchor or real[:half], real[half:]
    scored = {name: clouds[half:] or clouds for name, clouds in others.items()}
    rows = {name: _row(held_out, clouds, precision) for name, clouds in scored.items()}
    if training:
        target = np.concatenate(list(training))
        for name, clouds in scored.items():
            fit = fit_moments(np.concatenate(list(clouds)), target)
            moved = [cropped(fit.apply(points)) for points in clouds]
            rows[f"{name}_fitted"] = _row(held_out, moved, precision)
        rows["real_against_real"] = _row(held_out, training, None)
    return rows


def _row(real: _Clouds, other: _Clouds, precision: float | None) -> dict[str, Any]:
    raw = realism(real, other)
    return {
        "raw": raw,
        "normalised": {name: normalised(name, value) for name, value in raw.items()},
        **asdict(combined_score(raw, precision)),
    }


def score_sides(sides: Mapping[str, Side], detections: Path | None) -> dict[str, Any]:
    """Compute the protocol for a comparison: what stands under ``protocol`` in the report.

    Args:
        sides: "real", "synthetic" and perhaps "arbitrary", surveyed.
        detections: a detector's boxes in the real frames; None leaves that part out.

    Raises:
        InputError: the detections cannot be read or name none of the real frames, or a side has
            no point in the space that counts.
    """
    frames = {name: _frames(side) for name, side in sides.items()}
    clouds = {name: [cropped(frame.points) for frame in each] for name, each in frames.items()}
    for name, each in clouds.items():
        clouds[name] = [points for points in each if len(points)]
        if not clouds[name]:
            raise InputError(
                f"has no point within {CROP_M} m of the origin",
                file=sides[name].recording.path,
                expected="points in the sensor's frame",
            )
    notes = [
        "The challenge's scoring program was not to be had: Chamfer is the sum of both mean "
        f"squared distances, EMD an exact assignment of {EMD_POINTS} of {POINTS} points."
    ]
    mean: float | None = None
    each_class: dict[str, float | None] = {}
    labels = {frame.name: _labels(frame) for frame in frames["real"] if frame.boxes is not None}
    if detections is not None:
        told = {name: _inside(boxes) for name, boxes in read_detections(detections).items()}
        # A detector that found nothing at all need not name the frames.
        shared = {name: labels[name] for name in labels if name in told or not told}
        if not shared:
            raise InputError(
                "names none of the labelled real frames",
                file=detections,
                expected=", ".join(sorted(labels)[:3]) or "real frames that have labels",
            )
        mean, each_class = mean_precision(shared, told, CLASSES[:-1])
        if len(shared) < len(labels):
            notes.append(f"Detections are given in {len(shared)} of {len(labels)} real frames.")
        strange = sorted(set(told) - set(labels))
        if strange:
            notes.append(
                f"Detections in {len(strange)} frames that are no labelled real ones do not count: "
                f"{', '.join(strange[:3])}{', ...' if len(strange) > 3 else ''}."
            )
    else:
        notes.append("No detections were given: there is no detection score and no sum.")
    if len(clouds["real"]) < 2 and ANCHOR not in clouds:
        notes.append("A single real frame: nothing is held out, so nothing is fitted.")
    rows = score_clouds(
        clouds["real"],
        {
            "twin" if name == "synthetic" else name: clouds[name]
            for name in clouds
            if name not in ("real", ANCHOR)
        },
        mean,
        clouds.get(ANCHOR, ()),
    )
    return {
        "name": NAME,
        "scores": rows,
        "mean_average_precision": mean,
        "average_precision": each_class,
        "frames": {name: len(each) for name, each in clouds.items()},
        "limits": {name: list(limits) for name, limits in LIMITS.items()},
        "parameters": {"crop_m": list(CROP_M), "points": POINTS, "seed": SEED},
        "notes": notes,
    }


def _frames(side: Side) -> list[Frame]:
    usable = (index for index in range(side.count) if index not in side.problems)
    return [side.recording.read(index) for index, _ in zip(usable, range(2 * FRAMES), strict=False)]


def _labels(frame: Frame) -> list[Box]:
    boxes = frame.boxes
    if boxes is None:
        return []
    sources = boxes.source_names or ("",) * len(boxes)
    return _inside(
        Box(box, challenge_class(name, source))
        for box, name, source in zip(boxes.box, boxes.class_names, sources, strict=True)
    )


def _inside(boxes: Iterable[Box]) -> list[Box]:
    """Return the boxes whose middle is in the space that counts, labelled or detected."""
    return [one for one in boxes if bool((np.abs(one.box[:3]) <= CROP_M).all())]
