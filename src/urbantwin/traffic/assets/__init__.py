"""The actor catalogue: meshes of vehicles, two-wheelers with riders, and walkers."""

from urbantwin.traffic.assets.body import Body
from urbantwin.traffic.assets.catalogue import Asset, asset, asset_mesh, asset_names
from urbantwin.traffic.assets.coat import COATED_CLASSES, COATS, coated_mesh, coated_name
from urbantwin.traffic.assets.sized import sized_name

__all__ = [
    "COATED_CLASSES",
    "COATS",
    "Asset",
    "Body",
    "asset",
    "asset_mesh",
    "asset_names",
    "coated_mesh",
    "coated_name",
    "sized_name",
]
