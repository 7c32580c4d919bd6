"""Materials of triangles and what they do to a beam (table: ``material.csv``)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from urbantwin.taxonomy.semantic import table_rows

__all__ = ["Material", "material_id", "materials"]


@dataclass(frozen=True)
class Material:
    """A surface: diffuse reflectivity near 905 nm and the share of light that passes through."""

    id: int
    name: str
    reflectivity: float
    transmission: float
    source: str


@cache
def materials() -> dict[str, Material]:
    """Return every material by name, in the order of their numbers (0, 1, 2, ...)."""
    return {
        row["name"]: Material(
            int(row["id"]),
            row["name"],
            float(row["reflectivity"]),
            float(row["transmission"]),
            row["source"],
        )
        for row in table_rows("material.csv")
    }


def material_id(name: str) -> int:
    """Return a material's number; ``KeyError`` where there is no such material."""
    return materials()[name].id
