"""Names, units, definitions and sources of the measures of a report."""

from __future__ import annotations

from dataclasses import dataclass

from urbantwin.fidelity.beams import AZIMUTH_CELL_DEG

__all__ = ["HEADLINE", "MEASURES", "PUBLISHED", "Measure"]


@dataclass(frozen=True)
class Measure:
    """A measure of the report: smaller is better, 0 for equal clouds (except ``point_to_mesh``)."""

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

_BEAMS = (
    "rings, in the order of their elevation, and columns; where columns are not known on both "
    f"sides, rings and cells of {AZIMUTH_CELL_DEG} degrees of azimuth"
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
    "chamfer_m": Measure(
        "Chamfer",
        "m",
        "half the sum of both directions' mean distance to the nearest point",
        "Barrow et al. 1977, made symmetric",
    ),
    "chamfer_squared_m2": Measure(
        "Chamfer, squared",
        "m2",
        "sum of both directions' mean squared distance to the nearest point",
        "Fan, Su and Guibas 2017",
    ),
    "density_chamfer": Measure(
        "Density-aware Chamfer",
        "",
        "mean of 1 - exp(-d / 1 m) / n, n points sharing a nearest neighbour; samples of 20,000 "
        "points: 0 equal, 1 far apart",
        "Wu et al. 2021",
    ),
    "earth_mover_m": Measure(
        "Earth mover's",
        "m",
        "mean distance of the best one-to-one assignment of samples of 750 points, exact",
        "Rubner, Tomasi and Guibas 2000; solver: Crouse 2016",
    ),
    "sliced_earth_mover_m": Measure(
        "Earth mover's, sliced",
        "m",
        "mean over 64 directions of the earth mover's distance along them, 20,000 points",
        "Bonneel et al. 2015",
    ),
    "mean_discrepancy": Measure(
        "MMD, squared",
        "",
        "squared maximum mean discrepancy (biased), mean of Gaussian kernels of sigma 1, 4 and "
        "16 m, samples of 1,000 points: 0 equal, 2 far apart",
        "Gretton et al. 2012, equation 5",
    ),
    "frechet_places_m2": Measure(
        "Frechet of places",
        "m2",
        "squared Frechet distance of Gaussians fitted to x, y, z: mean and covariance only",
        "Dowson and Landau 1982",
    ),
    "frechet_shapes": Measure(
        "Frechet of shapes",
        "",
        "squared Frechet distance of Gaussians fitted to linearity, planarity, scattering, "
        "verticality and ln(spacing) of 16 neighbours of 3,000 points",
        "as Heusel et al. 2017, features of Demantke et al. 2011 in place of a network",
    ),
    "beam_range_error_median_m": Measure(
        "Range error per beam, median",
        "m",
        "median absolute difference of range over beams that return in both frames",
        _BEAMS,
    ),
    "beam_range_error_p95_m": Measure(
        "Range error per beam, P95",
        "m",
        "95th percentile of the absolute difference of range, the same beams",
        _BEAMS,
    ),
    "beam_disagreement": Measure(
        "Drop-out disagreement",
        "",
        "share of the beams that return in one frame and not in the other",
        _BEAMS,
    ),
    "beam_dropout_difference": Measure(
        "Drop-out difference",
        "",
        "absolute difference of the shares of beams without a return",
        _BEAMS,
    ),
}

#: Measures at the top of a report.
HEADLINE = ("hausdorff_p95_m", "js_mean", "point_to_mesh_mean_m")
#: What was published for digital twins of roadside sensors made by hand in CARLA, beside an
#: arbitrary site (Shahbaz and Agarwal 2025, "UrbanTwin", arXiv 2509.02903): other data and other
#: bins of histograms, so it is beside the figures of a report and not among them.
#: The twin, the arbitrary site, and the reduction in percent as it is printed there.
PUBLISHED: dict[str, tuple[float, float, float]] = {
    "hausdorff_p95_m": (3.645, 12.237, 70.2),
    "js_mean": (0.184, 0.505, 63.7),
    "point_to_mesh_mean_m": (0.795, 2.648, 69.9),
}
