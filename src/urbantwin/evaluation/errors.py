"""How far off the boxes are that were found: place, size, heading."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["box_errors"]


def box_errors(found: NDArray[np.float64], true: NDArray[np.float64]) -> dict[str, Any]:
    """Return means over pairs of a detected and a labelled box (P, 7), P >= 1.

    ``ate_m``, ``ase`` and ``aoe_rad`` are nuScenes' (Caesar et al. 2020): distance of centres in
    plan; 1 - IoU after centres and headings are laid on each other; smallest difference of yaw.
    Signed errors are found less true.
    """
    away = found[:, :2] - true[:, :2]
    place = np.hypot(*away.T)
    c, s = np.cos(true[:, 6]), np.sin(true[:, 6])
    size, true_size = found[:, 3:6], true[:, 3:6]
    common = np.minimum(size, true_size).prod(axis=1)
    either = size.prod(axis=1) + true_size.prod(axis=1) - common
    turn = found[:, 6] - true[:, 6]
    turn = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
    axis = np.minimum(turn, np.pi - turn)
    longer = size - true_size
    return {
        "boxes": len(found),
        "ate_m": float(place.mean()),
        "ase": float((1 - common / either).mean()),
        "aoe_rad": float(turn.mean()),
        "place_median_m": float(np.median(place)),
        "ahead_m": float((away[:, 0] * c + away[:, 1] * s).mean()),
        "left_m": float((away[:, 1] * c - away[:, 0] * s).mean()),
        "up_m": float((found[:, 2] - true[:, 2]).mean()),
        "longer_m": float(longer[:, 0].mean()),
        "wider_m": float(longer[:, 1].mean()),
        "higher_m": float(longer[:, 2].mean()),
        "axis_median_deg": float(np.degrees(np.median(axis))),
        "turned_round": float((turn > np.pi / 2).mean()),
    }
