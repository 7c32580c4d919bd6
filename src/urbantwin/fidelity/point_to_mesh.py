"""Distances from synthetic points to the surface rebuilt from a real cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.rebuilt_surface import Surface, rebuild_surface
from urbantwin.fidelity.sampling import sample_rows

__all__ = ["MAX_POINTS", "RealSurface", "Spread"]

#: More points than this are measured by a random sample of so many (drawn the same every time).
MAX_POINTS = 10_000
#: Every so many-th real point is kept out of the rebuild, to judge the rebuild by.
HELD_OUT = 10
#: Key of their draw: with that of the measured points, clouds of the same size would be measured by
#: the very points that the surface lacks.
_HELD_OUT_KEY = 1


@dataclass(frozen=True)
class Spread:
    """Distances in metres."""

    mean: float
    median: float
    p95: float

    @classmethod
    def of(cls, distances: NDArray[np.float64]) -> Spread:
        """Summarise (N,) distances, N >= 1."""
        median, p95 = np.percentile(distances, [50, 95])
        return cls(float(distances.mean()), float(median), float(p95))


class RealSurface:
    """The surface of one real frame, rebuilt from nine tenths of its points.

    Cloud-to-surface distance as in Metro (Cignoni, Rocchini, Scopigno 1998, "Metro: measuring
    error on simplified surfaces"), one way: from the synthetic points to the real surface. The
    tenth that was held out shows how far real points themselves lie from it (``rebuild_error``):
    figures below it say nothing about the twin.

    Attributes:
        surface: the triangles (see ``rebuilt_surface.py``).
        rebuild_error: distances of the real points that were held out; None for fewer than two
            points.
    """

    def __init__(self, real: NDArray[np.float64], origin: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        held_out = sample_rows(len(real), len(real) // HELD_OUT, _HELD_OUT_KEY)
        self.surface: Surface = rebuild_surface(np.delete(real, held_out, axis=0), origin)
        self._nearest = NearestTriangle(self.surface.vertices, self.surface.faces)
        self.rebuild_error: Spread | None = None
        if len(held_out):
            self.rebuild_error = self.distances_of(real[held_out])

    def distances_of(self, synthetic: NDArray[np.float64]) -> Spread:
        """Summarise the distances of (M, 3) points, M >= 1, to the surface."""
        return Spread.of(self.sampled_distances(synthetic)[1])

    def sampled_distances(
        self, synthetic: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return which of (M, 3) points were measured (S,), and their distances (S,) metres."""
        rows = sample_rows(len(synthetic), min(len(synthetic), MAX_POINTS))
        return rows, self._nearest.distances(synthetic[rows])
