"""Tables of what is usual, by group of countries."""

from __future__ import annotations

import csv
from importlib.resources import files

__all__ = ["rows_of", "tags_of"]


def rows_of(name: str, group: str) -> list[dict[str, str]]:
    """Return the rows of a table that hold for a group: its own before everybody's (``*``)."""
    text = (files(__package__) / name).read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
    return [row for own in (group, "*") for row in rows if row["group"] == own]


def tags_of(text: str) -> dict[str, str]:
    """Return the tags that a cell of a table holds: ``key=value`` by spaces."""
    return dict(pair.split("=", 1) for pair in text.split())
