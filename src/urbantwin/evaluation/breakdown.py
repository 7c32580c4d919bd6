"""Figures by range, by points and by how much of an object is hidden."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from urbantwin.evaluation.reading import Seen

__all__ = ["KINDS", "Bin", "bins_of"]

_RANGES_M = (0.0, 10.0, 20.0, 30.0, 40.0, 60.0, np.inf)
_POINTS = (0, 10, 30, 100, 300, np.inf)
#: The levels of docs/labels.md.
_HIDDEN = (0.0, 0.2, 0.6, 1.01)

#: What figures are broken down by, and how the bins are told.
KINDS = {"range": "m", "points": "points", "occlusion": "% hidden"}


@dataclass(frozen=True, eq=False)
class Bin:
    """Some of the objects, and the detections that are wrong for them where they find nothing.

    Attributes:
        kind: one of ``KINDS``.
        title: "10 to 20 m".
        labels: (L,) bool.
        detections: (N,) bool. Of what is hidden nothing tells: all of them.
    """

    kind: str
    title: str
    labels: NDArray[np.bool_]
    detections: NDArray[np.bool_]


def bins_of(seen: Seen) -> Iterator[Bin]:
    """Yield all bins, with objects in them or without."""
    truth = seen.truth
    for low, high in pairwise(_RANGES_M):
        yield Bin(
            "range",
            f"{low:g} to {high:g} m" if np.isfinite(high) else f"{low:g} m and more",
            (truth.range_m >= low) & (truth.range_m < high),
            (seen.range_m >= low) & (seen.range_m < high),
        )
    for low, high in pairwise(_POINTS):
        yield Bin(
            "points",
            f"{low:g} to {high - 1:g} points" if np.isfinite(high) else f"{low:g} points and more",
            (truth.num_points >= low) & (truth.num_points < high),
            (seen.num_points >= low) & (seen.num_points < high),
        )
    for low, high in pairwise(_HIDDEN):
        yield Bin(
            "occlusion",
            f"{100 * low:g} to {100 * min(high, 1.0):g} % hidden",
            (truth.occlusion >= low) & (truth.occlusion < high),
            np.ones(len(seen.detections), bool),
        )
