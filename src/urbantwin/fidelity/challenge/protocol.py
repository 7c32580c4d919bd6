"""The published challenge for synthetic roadside LiDAR: its constants and its formula.

UCF UrbanTwin Sim2Real LiDAR Challenge (Shahbaz and Agarwal, IEEE Big Data Cup 2026 and DriveX
2026): 0.6 of the score is a detector's precision in 50 real frames, 0.4 the similarity of 50
synthetic frames to real ones. The frames of each side are concatenated and cropped, and 10,000
points of each are compared.

Weights, classes, crop and limits are the challenge's. The number of points, the seed, and that the
"Frechet point distance" is the one of x, y, z, are from a participant's public repository
(amanupg/urbantwin-sim2real-lumpi), not from the organisers. The scoring program was not available.
Chosen here are the Chamfer distance (the sum of both directions' mean squared distance) and the
kernel (Gaussians of 1, 4 and 16 m). So are the number of points that are assigned to each other
(2,000 of the 10,000), and the random generator. Scores compare twins with each other and with the
anchors, not with a leaderboard.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = [
    "CLASSES",
    "CROP_M",
    "DETECTION_WEIGHT",
    "FRAMES",
    "LIMITS",
    "NAME",
    "REALISM_WEIGHT",
    "Score",
    "challenge_class",
    "check_protocol",
    "combined_score",
    "cropped",
    "normalised",
]

NAME = "urbantwin-challenge"
DETECTION_WEIGHT, REALISM_WEIGHT = 0.6, 0.4
#: Number of frames of a submission.
FRAMES = 50
#: Half extents of the crop about the sensor frame's origin, metres.
CROP_M = (40.0, 40.0, 5.0)
#: Best and worst value of each component.
LIMITS: dict[str, tuple[float, float]] = {
    "CD": (2.0, 30.0),
    "MMD": (0.0, 0.5),
    "EMD": (0.0, 5.0),
    "FPD": (0.0, 50.0),
    "AP": (0.0, 0.7),
}
CLASSES = ("Person", "Car", "Bicycle", "Motorcycle", "Bus", "Truck", "Van", "Unknown")
_OURS = {
    "pedestrian": "Person",
    "car": "Car",
    "bicycle": "Bicycle",
    "motorcycle": "Motorcycle",
    "bus": "Bus",
    "truck": "Truck",
    "van": "Van",
}


@dataclass(frozen=True)
class Score:
    """A score and its components.

    Attributes:
        detection: 0..1; None without detections or without labels.
        realism: 0..1.
        combined: 0.6 detection + 0.4 realism; None without ``detection``.
    """

    detection: float | None
    realism: float
    combined: float | None


def check_protocol(name: str) -> None:
    """Raise an error for an unknown protocol.

    Raises:
        InputError: there is no protocol of that name.
    """
    if name != NAME:
        raise InputError(f"{name!r} is not a protocol", place="--protocol", expected=NAME)


def challenge_class(name: str, source: str = "") -> str:
    """Return the challenge's class of an object, by the dataset's class name, otherwise by ours."""
    for known in CLASSES:
        if source.lower() == known.lower():
            return known
    return _OURS.get(name, "Unknown")


def cropped(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, 3) points within the crop."""
    return points[(np.abs(points) <= CROP_M).all(axis=1)]


def normalised(component: str, value: float) -> float:
    """Return a distance as a score: 1 at its best limit or below, 0 at its worst or above."""
    best, worst = LIMITS[component]
    return float(1 - np.clip((value - best) / (worst - best), 0, 1))


def combined_score(realism: dict[str, float], mean_precision: float | None) -> Score:
    """Return the score of raw components ("CD", "MMD", "EMD", "FPD") and mean precision."""
    real = float(np.mean([normalised(name, value) for name, value in realism.items()]))
    if mean_precision is None:
        return Score(None, real, None)
    low, high = LIMITS["AP"]
    found = float(np.clip((mean_precision - low) / (high - low), 0, 1))
    return Score(found, real, DETECTION_WEIGHT * found + REALISM_WEIGHT * real)
