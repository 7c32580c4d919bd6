"""Models on their place: by CRS, control points, similarity, geotag or registration."""

from urbantwin.reconstruct.georeference.heights import SiteHeights
from urbantwin.reconstruct.georeference.placed import Placed, placed

__all__ = ["Placed", "SiteHeights", "placed"]
