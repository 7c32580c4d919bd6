"""Scores of the protocol: realism of frames, and detection."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_json_value
from urbantwin.errors import InputError
from urbantwin.fidelity.challenge.average_precision import Box, mean_precision
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
from urbantwin.fidelity.cloud_distances import (
    chamfer_squared,
    earth_mover,
    frechet_places,
    mean_discrepancy,
)
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.nearest_point import nearest_distances
from urbantwin.fidelity.sampling import sampled
from urbantwin.fidelity.sides import ANCHOR, Side

__all__ = ["MomentFit", "fit_moments", "read_detections", "realism", "score_clouds", "score_sides"]

#: Number of points of each side, and the seed with which they are drawn.
POINTS, SEED = 10_000, 1234
#: Number of those points for the exact assignment (all would take minutes).
EMD_POINTS = 2_000


def realism(
    real: Sequence[NDArray[np.float64]], synthetic: Sequence[NDArray[np.float64]]
) -> dict[str, float]:
    """Return CD (m2), MMD, EMD (m) and FPD (m2) of concatenated frames.

    Args:
        real: (N, 3) points of each frame, metres, cropped, at least one point in all.
        synthetic: the same of the twin.
    """
    a, b = (sampled(np.concatenate(list(side)), POINTS, SEED) for side in (real, synthetic))
    return {
        "CD": chamfer_squared(nearest_distances(a, b)),
        "MMD": mean_discrepancy(a, b, most=EMD_POINTS, seed=SEED),
        "EMD": earth_mover(a, b, most=EMD_POINTS, seed=SEED),
        "FPD": frechet_places(a, b),
    }


@dataclass(frozen=True, eq=False)
class MomentFit:
    """The affine map that gives a cloud the mean and covariance of another.

    Attributes:
        matrix: (3, 3).
        source_mean: (3,) metres.
        target_mean: (3,) metres.
    """

    matrix: NDArray[np.float64]
    source_mean: NDArray[np.float64]
    target_mean: NDArray[np.float64]

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (N, 3) points after the map."""
        return (points - self.source_mean) @ self.matrix.T + self.target_mean


def fit_moments(source: NDArray[np.float64], target: NDArray[np.float64]) -> MomentFit:
    """Return the map of least displacement from one Gaussian to the other.

    A = S^(-1/2) (S^(1/2) T S^(1/2))^(1/2) S^(-1/2) (Dowson and Landau 1982; Olkin and Pukelsheim
    1982). It has no knowledge of streets: a cloud's errors remain, blurred. Directions in which the
    source has no extent are unchanged.

    Args:
        source: (N, 3) metres.
        target: (M, 3) metres.
    """
    s, t = (np.cov(cloud, rowvar=False, bias=True) for cloud in (source, target))
    value, vector = np.linalg.eigh(s)
    kept = value > 1e-9 * max(float(value.max()), 1e-12)
    root = np.sqrt(np.where(kept, value, 1.0))
    half, back = (vector * root) @ vector.T, (vector / root) @ vector.T
    inner, inner_vector = np.linalg.eigh(half @ t @ half)
    middle = (inner_vector * np.sqrt(np.maximum(inner, 0.0))) @ inner_vector.T
    return MomentFit(back @ middle @ back, source.mean(axis=0), target.mean(axis=0))


_EXPECTED = (
    '{"FRAME": [{"box": [x, y, z, length, width, height, yaw], "score": 0.9, "class": "Car"}]}'
)
#: Maximum coordinate or size, metres.
_LARGEST = 1e6


def read_detections(path: Path) -> dict[str, list[Box]]:
    """Return detections by frame from a JSON file.

    Boxes are in the frame of the real points: metres, radians, yaw counter-clockwise from +x.

    Raises:
        InputError: the file is invalid; the error gives the position.
    """
    read = read_json_value(path, _EXPECTED)
    if not isinstance(read, dict):
        raise InputError("is not a JSON object of frames", file=path, expected=_EXPECTED)
    return {str(frame): _boxes(path, str(frame), rows) for frame, rows in read.items()}


def _boxes(path: Path, frame: str, rows: Any) -> list[Box]:  # noqa: ANN401
    if not isinstance(rows, list):
        raise InputError("is not a list", file=path, place=frame, expected=_EXPECTED)
    found = []
    for index, row in enumerate(rows):
        place = f"{frame}[{index}]"
        if not isinstance(row, dict) or not {"box", "score", "class"} <= set(row):
            raise InputError(
                "lacks box, score or class", file=path, place=place, expected=_EXPECTED
            )
        box, score, name = row["box"], row["score"], row["class"]
        if not isinstance(box, list) or len(box) != 7 or not all(_is_number(v) for v in box):
            raise InputError("has no box of 7 numbers", file=path, place=place, expected=_EXPECTED)
        if min(box[3:6]) <= 0:
            raise InputError("has a box without extent", file=path, place=place, expected=_EXPECTED)
        if not _is_number(score):
            raise InputError("has no finite score", file=path, place=place, expected=_EXPECTED)
        if not isinstance(name, str) or name not in CLASSES:
            raise InputError(
                f"class {name!r:.60} is unknown",
                file=path,
                place=place,
                expected=", ".join(CLASSES),
            )
        found.append(Box(np.array(box, np.float64), name, float(score)))
    return found


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST


_Clouds = Sequence[NDArray[np.float64]]


def score_clouds(
    real: _Clouds,
    others: Mapping[str, _Clouds],
    precision: float | None = None,
    anchor: _Clouds = (),
) -> dict[str, Any]:
    """Score frames against held-out real ones.

    The first half of the real frames is available for fitting. Scored are the frames of the second
    half against the real frames of the same numbers, which the fit never uses: an exact copy
    has a distance of 0. Halves are used instead of every other frame, since neighbours in time are
    nearly equal. With an anchor, the fit uses the anchor and every real frame is scored.

    Args:
        real: (N, 3) cropped points of each frame, at least one frame.
        others: the same by name ("twin", "arbitrary"); a side with no more frames than the half is
            scored in full.
        precision: mean average precision of a detector in the real frames.
        anchor: the same of other real frames of the place.

    Returns:
        Rows by name: each of ``others``, the same with ``_fitted``, and ``real_against_real``: raw
            components, their scores, and the score.
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
    """Compute the protocol for a comparison: the entry ``protocol`` of the report.

    Args:
        sides: "real", "synthetic" and optionally "arbitrary", surveyed.
        detections: a detector's boxes in the real frames; None leaves that part out.

    Raises:
        InputError: the detections cannot be read or name no real frame, or a side has no point
            within the crop.
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
        # An empty file is valid for all frames.
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
    """Return the boxes whose centre is within the crop."""
    return [one for one in boxes if bool((np.abs(one.box[:3]) <= CROP_M).all())]
