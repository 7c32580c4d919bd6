"""What other formats call our classes (table: ``format_classes.csv``)."""

from __future__ import annotations

from functools import cache
from typing import Literal

from urbantwin.taxonomy.semantic import table_rows

__all__ = ["Labelled", "classes_in"]

#: What is labelled with a class: a box, or a point.
Labelled = Literal["box", "point"]


@cache
def classes_in(format_name: str, of: Labelled = "box") -> dict[str, str | None]:
    """Return what a format calls each of our classes; ``None`` where it has no such class.

    Args:
        format_name: as ``urbantwin export --to`` has it.
        of: boxes (`BOX_SEMANTICS`) or points (`semantic_classes`).

    Returns:
        Our class -> theirs, in the order of the table; empty where the format labels none of these.
    """
    return {
        row["ours"]: row["theirs"] or None
        for row in table_rows("format_classes.csv")
        if row["format"] == format_name and row["of"] == of
    }
