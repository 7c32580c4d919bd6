"""Argoverse 2 vector maps, read as a lane model."""

from urbantwin.roads.argoverse.file import anchor_of, is_placed
from urbantwin.roads.argoverse.read import drivable_area, is_argoverse, read_argoverse

__all__ = ["anchor_of", "drivable_area", "is_argoverse", "is_placed", "read_argoverse"]
