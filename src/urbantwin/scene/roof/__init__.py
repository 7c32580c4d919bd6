"""Roofs: their tags, and their facets over any footprint."""

from urbantwin.scene.roof.facet import Facet
from urbantwin.scene.roof.roof import roof_facets, roof_span
from urbantwin.scene.roof.tags import SHAPES, RoofTags, roof_tags, roof_yaw

__all__ = ["SHAPES", "Facet", "RoofTags", "roof_facets", "roof_span", "roof_tags", "roof_yaw"]
