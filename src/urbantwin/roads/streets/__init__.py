"""From netconvert's network to streets and ways through junctions, and what is on them."""

from urbantwin.roads.streets.furniture import furnished
from urbantwin.roads.streets.plan_view import planar_model

__all__ = ["furnished", "planar_model"]
