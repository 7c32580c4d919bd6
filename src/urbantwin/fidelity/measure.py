"""All measures of one cloud against one real frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from urbantwin.fidelity.beams import beam_agreement
from urbantwin.fidelity.cloud_distances import (
    P95Hausdorff,
    chamfer,
    chamfer_squared,
    density_chamfer,
    earth_mover,
    frechet_places,
    frechet_shapes,
    mean_discrepancy,
    sliced_earth_mover,
)
from urbantwin.fidelity.clouds import Cloud
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import Histograms, divergences, histograms_of
from urbantwin.fidelity.nearest_point import NearestDistances, PointTree, nearest_distances
from urbantwin.fidelity.point_to_mesh import RealSurface, Spread

__all__ = ["BACKGROUND", "FOREGROUND", "Figures", "Measured", "RealFrame"]

Figures = dict[str, float | None]
FOREGROUND, BACKGROUND = "foreground", "background"
#: Minimum number of points on both sides to measure a part of a frame.
_LEAST_POINTS = 10


@dataclass(frozen=True, eq=False)
class Measured:
    """Results of one cloud against the real frame.

    Attributes:
        figures: values by ``definitions.MEASURES``; None where undefined.
        parts: values of ``FOREGROUND`` and ``BACKGROUND``, if both clouds are separated.
        histograms: histograms of the cloud.
        missing: (N,) distance of each real point to the nearest point of the cloud, metres.
    """

    figures: Figures
    parts: dict[str, Figures]
    histograms: Histograms
    missing: NDArray[np.float64]


class RealFrame:
    """A real frame, prepared once for measuring several others against it.

    The background is compared with the whole of the other frame, since occlusion by an actor is no
    error. The foreground is compared with the other foreground, with a surface of its own.

    Args:
        frame: the real points.
        foreground: (N,) mask of points on actors; None measures the whole frame only.
        intensity_scale: full scale of its intensity; None leaves intensity out.
        origin: (3,) position of the sensor in the frame of the points, metres.
    """

    def __init__(
        self,
        frame: Frame,
        *,
        foreground: NDArray[np.bool_] | None = None,
        intensity_scale: float | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.frame = frame
        self._foreground = foreground
        self._origin = np.asarray(origin, np.float64)
        self.histograms = self._histograms(frame.cloud, intensity_scale)
        self.surface = RealSurface(frame.points, self._origin)
        self._tree = PointTree(frame.points)
        self._actors: Cloud | None = None
        if foreground is not None and foreground.sum() >= _LEAST_POINTS:
            self._actors = frame.only(foreground).cloud
            self._actor_surface = RealSurface(self._actors.points, self._origin)
            self._actor_histograms = self._histograms(self._actors, intensity_scale)
        if foreground is not None and not foreground.all():
            self._still_histograms = self._histograms(
                frame.only(~foreground).cloud, intensity_scale
            )

    def _histograms(self, cloud: Cloud, scale: float | None) -> Histograms:
        return histograms_of(cloud, intensity_scale=scale, origin=self._origin)

    def measure(
        self,
        other: Frame,
        *,
        foreground: NDArray[np.bool_] | None = None,
        intensity_scale: float | None = None,
    ) -> Measured:
        """Measure another frame of the same sensor at the same place.

        Args:
            other: the frame.
            foreground: (M,) mask of its points on actors; None: not separated.
            intensity_scale: full scale of its intensity; None leaves intensity out.
        """
        a, b = self.frame.points, other.points
        near = nearest_distances(a, b, real_tree=self._tree)
        theirs = self._histograms(other.cloud, intensity_scale)
        rows, mesh = self.surface.sampled_distances(b)
        figures = _of_distances(near, mesh) | _of_histograms(self.histograms, theirs)
        figures |= {
            "chamfer_squared_m2": chamfer_squared(near),
            "density_chamfer": density_chamfer(a, b),
            "earth_mover_m": earth_mover(a, b),
            "sliced_earth_mover_m": sliced_earth_mover(a, b),
            "mean_discrepancy": mean_discrepancy(a, b),
            "frechet_places_m2": frechet_places(a, b),
            "frechet_shapes": frechet_shapes(a, b),
        }
        figures |= _of_beams(self.frame, other)
        parts: dict[str, Figures] = {}
        if self._foreground is not None and foreground is not None:
            if self._actors is not None and foreground.sum() >= _LEAST_POINTS:
                parts[FOREGROUND] = self._measure_actors(other.only(foreground), intensity_scale)
            mine, its = ~self._foreground, ~foreground
            if min(mine.sum(), its.sum(), its[rows].sum()) >= _LEAST_POINTS:
                still = NearestDistances(near.real_to_synthetic[mine], near.synthetic_to_real[its])
                still_histograms = self._histograms(other.only(its).cloud, intensity_scale)
                parts[BACKGROUND] = _of_distances(still, mesh[its[rows]]) | _of_histograms(
                    self._still_histograms, still_histograms
                )
        return Measured(figures, parts, theirs, near.real_to_synthetic)

    def _measure_actors(self, actors: Frame, intensity_scale: float | None) -> Figures:
        if self._actors is None:
            raise ValueError("the real frame has no actors")
        _, mesh = self._actor_surface.sampled_distances(actors.points)
        return _of_distances(
            nearest_distances(self._actors.points, actors.points), mesh
        ) | _of_histograms(self._actor_histograms, self._histograms(actors.cloud, intensity_scale))


def _of_distances(near: NearestDistances, mesh: NDArray[np.float64]) -> Figures:
    hausdorff, surface = P95Hausdorff.of(near), Spread.of(mesh)
    return {
        "hausdorff_p95_m": hausdorff.both,
        "hausdorff_p95_real_to_synthetic_m": hausdorff.real_to_synthetic,
        "hausdorff_p95_synthetic_to_real_m": hausdorff.synthetic_to_real,
        "point_to_mesh_mean_m": surface.mean,
        "point_to_mesh_median_m": surface.median,
        "point_to_mesh_p95_m": surface.p95,
        "chamfer_m": chamfer(near),
    }


def _of_histograms(real: Histograms, other: Histograms) -> Figures:
    return {f"js_{name}": value for name, value in divergences(real, other).items()}


def _of_beams(real: Frame, other: Frame) -> Figures:
    found = beam_agreement(real, other)
    if found is None:
        return {}
    return {
        "beam_range_error_median_m": found.range_error_abs_median_m,
        "beam_range_error_p95_m": found.range_error_abs_p95_m,
        "beam_disagreement": 1 - found.same_outcome,
        "beam_dropout_difference": abs(found.real_dropout - found.synthetic_dropout),
    }
