"""Static objects at a fixed site that are mistaken for people or riders: posts, signs, hedges.

A detector sees one frame and cannot recognise them. Frames of another hour from the same sensors
can: no person is at the same position in half of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from urbantwin.detections.detections import Detections
from urbantwin.errors import InputError

__all__ = ["FEWEST_FRAMES", "frames_about", "standing_places", "without_standing"]

#: Classes for which thin static objects are mistaken. A parked car remains a car.
_SLIGHT = ("bicycle", "motorcycle", "pedestrian")
#: Detections within this distance are of one object, metres: half a person's width, and the
#: variation of box centres.
_APART_M = 0.4
#: An object is static if it is detected in this share of the frames,
_OFTEN = 0.5
#: of at least this number.
FEWEST_FRAMES = 10


def frames_about(
    places: NDArray[np.float64], frame: NDArray[np.int64], apart_m: float
) -> tuple[list[list[int]], NDArray[np.int64]]:
    """Return the neighbours of each position, itself included, and the number of their frames (N,).

    Args:
        places: (N, 2) x and y, metres.
        frame: (N,) frame of each position.
        apart_m: radius of the neighbourhood, metres.
    """
    near = cKDTree(places).query_ball_point(places, apart_m).tolist() if len(places) else []
    return near, np.array([len(np.unique(frame[one])) for one in near], np.int64)


def standing_places(found: Detections, file: Path | None = None) -> NDArray[np.float64]:
    """Return the positions (K, 2), x and y, of static objects among detections.

    Args:
        found: detections of fixed sensors, over a longer time than any person stays at one
            position.
        file: source of the detections, for errors.

    Raises:
        InputError: there are too few frames.
    """
    count = len(found.frames)
    if count < FEWEST_FRAMES:
        raise InputError(
            f"{count} frames are too few to find static objects",
            file=file,
            expected=f"at least {FEWEST_FRAMES}, over longer than a person stays at one place",
        )
    slight = found.only([name in _SLIGHT for name in found.class_names])
    places = slight.box[:, :2]
    _, seen_in = frames_about(places, slight.frame, _APART_M)
    return np.asarray(places[seen_in >= _OFTEN * count])


def without_standing(found: Detections, places: NDArray[np.float64]) -> Detections:
    """Return detections without people and riders at positions of `standing_places`.

    Args:
        found: detections of the same sensors, in the same frame of reference.
        places: (K, 2) x and y, metres.
    """
    if not len(places) or not len(found):
        return found
    away, _ = cKDTree(places).query(found.box[:, :2])
    slight = np.array([name in _SLIGHT for name in found.class_names], bool)
    return found.only(~slight | (away > _APART_M))
