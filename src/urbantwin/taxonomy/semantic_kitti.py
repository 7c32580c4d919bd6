"""SemanticKITTI's labels (table: ``semantic_kitti.csv``); most of ours have their numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from urbantwin.taxonomy.semantic import semantic_classes, table_rows

__all__ = ["MOVING", "KittiLabel", "kitti_labels"]

#: What stands before the name of what moves.
MOVING = "moving-"


@dataclass(frozen=True)
class KittiLabel:
    """A label.

    Attributes:
        id: its number in a ``.label``.
        name: its name.
        learned: the class that the benchmark of single scans learns; 0 for what it ignores.
        colour: red, green, blue, 0..255.
    """

    id: int
    name: str
    learned: int
    colour: tuple[int, int, int]


@cache
def kitti_labels() -> dict[str, KittiLabel]:
    """Return every label by name, in the order of their numbers."""
    colours = {one.id: one.colour for one in semantic_classes().values()}
    return {
        row["name"]: KittiLabel(
            int(row["id"]), row["name"], int(row["learned"]), colours[int(row["like"])]
        )
        for row in table_rows("semantic_kitti.csv")
    }
