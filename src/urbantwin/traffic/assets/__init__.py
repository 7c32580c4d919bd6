"""The actor catalogue: meshes of vehicles, two-wheelers with riders, and walkers."""

from urbantwin.traffic.assets.asset_name import (
    COATED_CLASSES,
    COATS,
    AssetName,
    coated_mesh,
    coated_name,
    mesh_among,
    scaled_mesh,
    sized_name,
)
from urbantwin.traffic.assets.catalogue import (
    Asset,
    asset,
    asset_mesh,
    asset_names,
    bending_names,
    bodies_of_asset,
    class_of,
)
from urbantwin.traffic.assets.fleet import Fleet, OwnBodies
from urbantwin.traffic.assets.heavy import Body

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
