"""Semantic classes of points and triangles (table: ``semantic.csv``)."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

__all__ = ["GROUND_CLASSES", "SemanticClass", "semantic_classes", "semantic_id", "table_rows"]


#: Classes that one can stand on.
GROUND_CLASSES = ("road", "parking", "sidewalk", "other-ground", "terrain")


@dataclass(frozen=True)
class SemanticClass:
    """A class: its number (SemanticKITTI's), name, colour (0..255) and whether it is countable."""

    id: int
    name: str
    colour: tuple[int, int, int]
    thing: bool


def table_rows(name: str) -> list[dict[str, str]]:
    """Read a table of this package, its comment lines left out."""
    lines = files(__package__).joinpath(name).read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


@cache
def semantic_classes() -> dict[str, SemanticClass]:
    """Return every class by name."""
    return {
        row["name"]: SemanticClass(
            int(row["id"]),
            row["name"],
            (int(row["red"]), int(row["green"]), int(row["blue"])),
            row["thing"] == "1",
        )
        for row in table_rows("semantic.csv")
    }


def semantic_id(name: str) -> int:
    """Return a class's number; ``KeyError`` where there is no such class."""
    return semantic_classes()[name].id
