"""The actor catalogue: meshes of cars, trucks, buses, two-wheelers with riders, and walkers."""

from urbantwin.traffic.assets.catalogue import Asset, asset, asset_mesh, asset_names

__all__ = ["Asset", "asset", "asset_mesh", "asset_names"]
