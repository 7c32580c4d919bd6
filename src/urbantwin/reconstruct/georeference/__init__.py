"""Models on their place: by CRS, control points, similarity, geotag or registration."""

from urbantwin.reconstruct.georeference.heights import SiteHeights
from urbantwin.reconstruct.georeference.placed import Placed, placed
from urbantwin.reconstruct.georeference.register import Registration

__all__ = ["Placed", "Registration", "SiteHeights", "placed"]
