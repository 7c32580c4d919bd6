"""Kinds of a building's faces."""

from __future__ import annotations

__all__ = ["DOOR", "FLOOR", "GLASS", "ROOF", "WALL"]

#: Undersides, walls, roofs, window panes, doors.
FLOOR, WALL, ROOF, GLASS, DOOR = range(5)
