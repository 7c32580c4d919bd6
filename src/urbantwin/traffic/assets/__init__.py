"""The actor catalogue: meshes of vehicles, two-wheelers with riders, and walkers."""

from urbantwin.traffic.assets.asset_name import AssetName, sized_name
from urbantwin.traffic.assets.body import Body
from urbantwin.traffic.assets.catalogue import (
    Asset,
    asset,
    asset_mesh,
    asset_names,
    bending_names,
    bodies_of_asset,
    class_of,
)
from urbantwin.traffic.assets.coat import COATED_CLASSES, COATS, coated_mesh, coated_name
from urbantwin.traffic.assets.fleet import Fleet
from urbantwin.traffic.assets.own import OwnBodies
from urbantwin.traffic.assets.scaled import mesh_among, scaled_mesh

__all__ = [
    "COATED_CLASSES",
    "COATS",
    "Asset",
    "AssetName",
    "Body",
    "Fleet",
    "OwnBodies",
    "asset",
    "asset_mesh",
    "asset_names",
    "bending_names",
    "bodies_of_asset",
    "class_of",
    "coated_mesh",
    "coated_name",
    "mesh_among",
    "scaled_mesh",
    "sized_name",
]
