"""3D Tiles: trees of tiles in a folder, an archive or on a server."""

from urbantwin.io.tiles3d.reader import middle_of_tileset, read_tiles3d

__all__ = ["middle_of_tileset", "read_tiles3d"]
