"""Streets and connecting roads from netconvert's network, and the objects on them."""

from urbantwin.roads.streets.furniture import furnished
from urbantwin.roads.streets.plan_view import planar_model

__all__ = ["furnished", "planar_model"]
