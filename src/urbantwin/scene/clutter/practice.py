"""Usual objects beside streets by country: plot boundaries, objects at kerbs, and their tables.

Heights are the maximum that building law allows towards a street without a permit, or slightly
less. Shares of plots with a wall, a hedge or a fence are estimates, from photographs of streets.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

__all__ = [
    "Boundary",
    "Kerbside",
    "boundaries",
    "group_of",
    "kerbside_kinds",
    "pairs_of",
    "rows_of",
    "side_boundaries",
    "tags_of",
]


def rows_of(name: str, group: str) -> list[dict[str, str]]:
    """Return the rows of a table for a group: its own before the general ones (``*``)."""
    text = (files(__package__) / name).read_text(encoding="utf-8").splitlines()
    rows = list(csv.DictReader(line for line in text if not line.startswith("#")))
    return [row for own in (group, "*") for row in rows if row["group"] == own]


def tags_of(text: str) -> dict[str, str]:
    """Return the tags in a cell of a table."""
    return dict(pairs_of(text))


def pairs_of(text: str) -> list[tuple[str, str]]:
    """Return keys and values of a cell of a table: ``key=value`` by spaces, a key also twice."""
    return [(key, value) for key, _, value in (pair.partition("=") for pair in text.split())]


GROUPS: Mapping[str, str] = {
    **dict.fromkeys(("GB", "IE"), "britain"),
    **dict.fromkeys(("US", "CA"), "america"),
    **dict.fromkeys(("AU", "NZ"), "australia"),
    **dict.fromkeys(("JP",), "japan"),
    **dict.fromkeys("TW CN HK MO KR SG IN BD PK LK NP TH VN KH MY ID PH EG".split(), "asia"),
}


@dataclass(frozen=True)
class Boundary:
    """A kind of plot boundary: the share of plots with it, and its tags as in the map."""

    share: float
    barrier: str
    height_m: float
    more: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Kerbside:
    """A kind of piece at kerbs: per km of street beside shops, and beside dwellings."""

    kind: str
    business: float
    dwellings: float
    may_stand_back: bool
    across_m: float
    tags: Mapping[str, str]


def group_of(country: str) -> str:
    """Return the group of countries whose practice a country (ISO 3166-1 alpha-2) has."""
    return GROUPS.get(country, "europe")


def boundaries(group: str, use: str) -> tuple[Boundary, ...]:
    """Return the usual boundaries of plots of a use: dwellings, business, industry, institution."""
    return _boundaries("front", use) or _boundaries("front", group)


def side_boundaries(group: str) -> tuple[Boundary, ...]:
    """Return the usual boundaries between adjacent plots, behind the front."""
    return _boundaries("side", group)


@cache
def _boundaries(place: str, group: str) -> tuple[Boundary, ...]:
    return tuple(
        Boundary(
            float(row["share"]),
            row["barrier"],
            float(row["height_m"]),
            tuple(pairs_of(row["tags"])),
        )
        for row in rows_of("boundaries.csv", group)
        if row["place"] == place
    )


@cache
def kerbside_kinds(group: str) -> tuple[Kerbside, ...]:
    """Return the usual objects of a group of countries, its own before the general ones."""
    found: dict[str, Kerbside] = {}
    for row in rows_of("kerbside.csv", group):
        if row["kind"] not in found:
            found[row["kind"]] = Kerbside(
                row["kind"],
                float(row["business"]),
                float(row["dwellings"]),
                row["back"] == "1",
                float(row["across_m"]),
                tags_of(row["tags"]),
            )
    return tuple(found.values())
