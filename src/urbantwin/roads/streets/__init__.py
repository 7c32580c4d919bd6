"""Streets and connecting roads from netconvert's network, and the objects on them."""

from urbantwin.roads.streets.furniture import with_furniture
from urbantwin.roads.streets.plan_view import planar_model

__all__ = ["planar_model", "with_furniture"]
