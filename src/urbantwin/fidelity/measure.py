"""All measures of one cloud against one real frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from urbantwin.fidelity.clouds import Cloud
from urbantwin.fidelity.hausdorff import p95_hausdorff
from urbantwin.fidelity.histograms import Histograms, divergences, histograms_of
from urbantwin.fidelity.point_to_mesh import RealSurface

__all__ = ["MEASURES", "Measure", "RealFrame"]


@dataclass(frozen=True)
class Measure:
    """A figure of the report: less is better, 0 for equal clouds (but for ``point_to_mesh``)."""

    title: str
    unit: str
    definition: str
    source: str


_JSD = "Lin 1991, IEEE Trans. Inf. Theory 37(1), base 2: 0 equal, 1 disjoint"
_P95 = "Huttenlocher et al. 1993, partial Hausdorff distance, quantile 0.95"
_METRO = (
    "Cignoni et al. 1998 (Metro), one way: synthetic points to the surface rebuilt from nine "
    "tenths of the real points (Delaunay over azimuth and elevation; long and grazing triangles "
    "are cut)"
)

MEASURES: dict[str, Measure] = {
    "hausdorff_p95_m": Measure(
        "P95 Hausdorff", "m", "the larger of the two directions below", _P95
    ),
    "hausdorff_p95_real_to_synthetic_m": Measure(
        "real to synthetic",
        "m",
        "95th percentile of the distances from real points to the nearest synthetic point: "
        "what the synthetic frame lacks",
        _P95,
    ),
    "hausdorff_p95_synthetic_to_real_m": Measure(
        "synthetic to real",
        "m",
        "95th percentile of the distances from synthetic points to the nearest real point: "
        "what the synthetic frame adds",
        _P95,
    ),
    "point_to_mesh_mean_m": Measure("Point to mesh, mean", "m", "mean distance", _METRO),
    "point_to_mesh_median_m": Measure("Point to mesh, median", "m", "median distance", _METRO),
    "point_to_mesh_p95_m": Measure("Point to mesh, P95", "m", "95th percentile", _METRO),
    "js_occupancy": Measure("JS occupancy", "", "share of the points in each 1 m voxel", _JSD),
    "js_range": Measure("JS range", "", "points by distance, bins of 1 m to 250 m", _JSD),
    "js_height": Measure("JS height", "", "points by z, bins of 0.25 m, -20 to 60 m", _JSD),
    "js_intensity": Measure(
        "JS intensity",
        "",
        "points by intensity, 50 bins of its full scale (1, 255 or 65535: the least that holds "
        "the largest value of the folder)",
        _JSD,
    ),
    "js_density": Measure(
        "JS density",
        "",
        "mean points per occupied 1 m voxel by distance, bins of 5 m to 250 m",
        _JSD,
    ),
    "js_mean": Measure("JS mean", "", "mean of those of the five that both clouds have", _JSD),
}


class RealFrame:
    """A real frame, prepared once to measure several clouds against it.

    Args:
        cloud: the real points.
        intensity_scale: full scale of its intensity; None leaves intensity out.
        origin: (3,) the sensor's place in the frame of the points, metres.
    """

    def __init__(
        self,
        cloud: Cloud,
        *,
        intensity_scale: float | None = None,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        self.cloud = cloud
        self._origin = np.asarray(origin, np.float64)
        self.histograms: Histograms = histograms_of(
            cloud, intensity_scale=intensity_scale, origin=self._origin
        )
        self.surface = RealSurface(cloud.points, self._origin)
        self._tree = cKDTree(cloud.points)

    def measure(
        self, other: Cloud, *, intensity_scale: float | None = None
    ) -> tuple[dict[str, float | None], Histograms]:
        """Return every figure of ``MEASURES`` for another cloud, and that cloud's histograms.

        A figure is None where it is not defined: the intensity of a cloud without one.
        """
        hausdorff = p95_hausdorff(self.cloud.points, other.points, real_tree=self._tree)
        mesh = self.surface.distances_of(other.points)
        theirs = histograms_of(other, intensity_scale=intensity_scale, origin=self._origin)
        figures: dict[str, float | None] = {
            "hausdorff_p95_m": hausdorff.both,
            "hausdorff_p95_real_to_synthetic_m": hausdorff.real_to_synthetic,
            "hausdorff_p95_synthetic_to_real_m": hausdorff.synthetic_to_real,
            "point_to_mesh_mean_m": mesh.mean,
            "point_to_mesh_median_m": mesh.median,
            "point_to_mesh_p95_m": mesh.p95,
        }
        for name, value in divergences(self.histograms, theirs).items():
            figures[f"js_{name}"] = value
        return figures, theirs
