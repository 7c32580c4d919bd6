"""Measures of similarity between real and synthetic frames of one place, and their report."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.fidelity.background_subtraction import Background
    from urbantwin.fidelity.beams import BeamAgreement, beam_agreement
    from urbantwin.fidelity.cloud_distances import (
        P95Hausdorff,
        chamfer,
        chamfer_squared,
        density_chamfer,
        earth_mover,
        frechet,
        frechet_places,
        frechet_shapes,
        mean_discrepancy,
        sliced_earth_mover,
    )
    from urbantwin.fidelity.clouds import Cloud, cloud_files, read_cloud
    from urbantwin.fidelity.compare import compare
    from urbantwin.fidelity.definitions import MEASURES
    from urbantwin.fidelity.frame import Boxes, Frame
    from urbantwin.fidelity.histograms import Histograms, divergences, histograms_of, jensen_shannon
    from urbantwin.fidelity.nearest_point import NearestDistances, nearest_distances
    from urbantwin.fidelity.object_statistics import ObjectStatistics, object_differences
    from urbantwin.fidelity.point_to_mesh import RealSurface, Spread, Surface, rebuild_surface
    from urbantwin.fidelity.report import Report

__all__ = [
    "MEASURES",
    "Background",
    "BeamAgreement",
    "Boxes",
    "Cloud",
    "Frame",
    "Histograms",
    "NearestDistances",
    "ObjectStatistics",
    "P95Hausdorff",
    "RealSurface",
    "Report",
    "Spread",
    "Surface",
    "beam_agreement",
    "chamfer",
    "chamfer_squared",
    "cloud_files",
    "compare",
    "density_chamfer",
    "divergences",
    "earth_mover",
    "frechet",
    "frechet_places",
    "frechet_shapes",
    "histograms_of",
    "jensen_shannon",
    "mean_discrepancy",
    "nearest_distances",
    "object_differences",
    "read_cloud",
    "rebuild_surface",
    "sliced_earth_mover",
]

names_on_demand(__name__)
