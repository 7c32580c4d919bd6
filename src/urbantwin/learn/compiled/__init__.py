"""Loops over points and cells, compiled by numba."""

from urbantwin.learn.compiled.box_points import points_in_boxes
from urbantwin.learn.compiled.gather import cells_of, gathered
from urbantwin.learn.compiled.splat import drawn_centres, drawn_ignored

__all__ = ["cells_of", "drawn_centres", "drawn_ignored", "gathered", "points_in_boxes"]
