"""Where fetched tiles are kept: a folder shared by all runs that name it."""

from __future__ import annotations

__all__ = ["CACHE", "USABLE"]

#: Environment variable that names the folder.
CACHE = "URBANTWIN_TILE_CACHE"
#: What it has to name.
USABLE = f"a folder of your own with room, or no {CACHE}"
