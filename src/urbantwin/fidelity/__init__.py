"""Measures between real and synthetic frames of one place, and the report about them."""

from urbantwin.fidelity.clouds import Cloud, cloud_files, read_cloud
from urbantwin.fidelity.compare import compare
from urbantwin.fidelity.divergence import jensen_shannon
from urbantwin.fidelity.hausdorff import P95Hausdorff, p95_hausdorff
from urbantwin.fidelity.histograms import Histograms, divergences, histograms_of
from urbantwin.fidelity.point_to_mesh import RealSurface, Spread
from urbantwin.fidelity.report import Report
from urbantwin.fidelity.surface import Surface, rebuild_surface

__all__ = [
    "Cloud",
    "Histograms",
    "P95Hausdorff",
    "RealSurface",
    "Report",
    "Spread",
    "Surface",
    "cloud_files",
    "compare",
    "divergences",
    "histograms_of",
    "jensen_shannon",
    "p95_hausdorff",
    "read_cloud",
    "rebuild_surface",
]
