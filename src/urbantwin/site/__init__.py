"""What a person says about a place: the site, its rig, its OpenStreetMap extract, its DEM."""

from urbantwin.site.extract import ClippedWays, Extract, OsmFeature, Relation, Way, read_extract
from urbantwin.site.rig import Effects, RigSpec, SensorSpec, load_rig_spec

__all__ = [
    "ClippedWays",
    "Effects",
    "Extract",
    "OsmFeature",
    "Relation",
    "RigSpec",
    "SensorSpec",
    "Way",
    "load_rig_spec",
    "read_extract",
]
