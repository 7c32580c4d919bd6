"""3D Tiles: trees of tiles in a folder, an archive or on a server."""

from urbantwin.reconstruct.tiles3d.reader import read_tiles3d

__all__ = ["read_tiles3d"]
