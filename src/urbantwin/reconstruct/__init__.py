"""Imported geometry: meshes, 3D Tiles and point clouds: placing, cleaning, classification."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.io.model import Geotag, ImportedModel, PointCloud, TriangleMesh
    from urbantwin.reconstruct.reconstruction import Reconstruction, SourceFigures, SurveyedTree
    from urbantwin.reconstruct.source_summary import outcome
    from urbantwin.reconstruct.surroundings import Surroundings, surroundings_of

__all__ = [
    "Geotag",
    "ImportedModel",
    "PointCloud",
    "Reconstruction",
    "SourceFigures",
    "Surroundings",
    "SurveyedTree",
    "TriangleMesh",
    "outcome",
    "surroundings_of",
]

names_on_demand(__name__)
