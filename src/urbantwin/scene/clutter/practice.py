"""What is usual beside streets, by country: plot boundaries, and how many pieces stand at kerbs.

Heights are the most that building law allows towards a street without a permit, or somewhat less;
shares of plots with a wall, a hedge or a fence are estimates, from photographs of streets.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

from urbantwin.scene.clutter.table import rows_of, tags_of

__all__ = ["Boundary", "Kerbside", "boundaries", "group_of", "kerbside_kinds", "side_boundaries"]

GROUPS: Mapping[str, str] = {
    **dict.fromkeys(("GB", "IE"), "britain"),
    **dict.fromkeys(("US", "CA"), "america"),
    **dict.fromkeys(("AU", "NZ"), "australia"),
    **dict.fromkeys(("JP",), "japan"),
    **dict.fromkeys("TW CN HK MO KR SG IN BD PK LK NP TH VN KH MY ID PH EG".split(), "asia"),
}


@dataclass(frozen=True)
class Boundary:
    """A kind of plot boundary: what share of plots has it, and how a mapper would tag it."""

    share: float
    barrier: str
    height_m: float
    more: tuple[tuple[str, str], ...] = ()


def _fence(share: float, height_m: float, kind: str) -> Boundary:
    return Boundary(share, "fence", height_m, (("fence_type", kind),))


def _wall(share: float, height_m: float, material: str) -> Boundary:
    return Boundary(share, "wall", height_m, (("material", material),))


#: Heights: 1 m beside highways (England, General Permitted Development Order 2015, schedule 2,
#: part 2, class A); 1.25 m (Berlin, Nachbarrechtsgesetz, section 23); 42 to 48 in (zoning codes of
#: cities of the US); walls of blocks of 2.2 m at most (Japan, Building Standards Act, order,
#: article 62-8), 1.2 m of them solid as a rule; 1.2 m (Western Australia, R-Codes). As remembered.
BOUNDARIES: Mapping[str, tuple[Boundary, ...]] = {
    "europe": (
        Boundary(0.30, "hedge", 1.25), _fence(0.25, 1.2, "metal_bars"), _wall(0.15, 0.9, "plaster"),
    ),
    "britain": (
        _wall(0.45, 0.9, "brick"), Boundary(0.25, "hedge", 1.2), _fence(0.10, 1.0, "picket"),
    ),
    "america": (
        Boundary(0.12, "hedge", 1.1), _fence(0.12, 1.1, "picket"),
        _fence(0.12, 1.2, "chain_link"), _wall(0.08, 0.6, "concrete"),
    ),
    "australia": (
        _fence(0.25, 1.2, "picket"), _wall(0.20, 1.0, "brick"), Boundary(0.15, "hedge", 1.2),
    ),
    "japan": (
        _wall(0.50, 1.4, "concrete"), Boundary(0.15, "hedge", 1.4), _fence(0.15, 1.2, "metal_bars"),
    ),
    "asia": (_wall(0.60, 1.6, "plaster"), _fence(0.15, 1.6, "metal_bars")),
    "industry": (_fence(0.55, 1.8, "chain_link"), _wall(0.15, 1.8, "concrete")),
    "institution": (
        _fence(0.35, 1.5, "metal_bars"), Boundary(0.20, "hedge", 1.2), _wall(0.10, 1.0, "stone"),
    ),
    "business": (Boundary(0.15, "hedge", 0.9), _wall(0.08, 0.6, "concrete")),
}  # fmt: skip


#: Between neighbours: up to 1.8 or 2 m behind the front of houses, as the same laws say; estimates.
SIDES: Mapping[str, tuple[Boundary, ...]] = {
    "europe": (
        Boundary(0.30, "hedge", 1.7), _fence(0.35, 1.5, "chain_link"), _fence(0.15, 1.7, "panel"),
    ),
    "britain": (_fence(0.60, 1.75, "close_boarded"), Boundary(0.20, "hedge", 1.7)),
    "america": (
        _fence(0.45, 1.75, "wood_panel"), _fence(0.15, 1.2, "chain_link"),
        Boundary(0.10, "hedge", 1.6),
    ),
    "australia": (_fence(0.75, 1.8, "metal_panel"), Boundary(0.10, "hedge", 1.6)),
    "japan": (_wall(0.55, 1.4, "concrete"), _fence(0.25, 1.4, "metal_bars")),
    "asia": (_wall(0.70, 1.7, "plaster"),),
}  # fmt: skip


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
    """Return whose practice a country (ISO 3166-1 alpha-2, empty if unknown) follows here."""
    return GROUPS.get(country, "europe")


def boundaries(group: str, use: str) -> tuple[Boundary, ...]:
    """Return the usual boundaries of plots of a use: dwellings, business, industry, institution."""
    return BOUNDARIES[use if use in BOUNDARIES else group]


def side_boundaries(group: str) -> tuple[Boundary, ...]:
    """Return the usual boundaries between a plot and its neighbour's, behind the front."""
    return SIDES[group]


@cache
def kerbside_kinds(group: str) -> tuple[Kerbside, ...]:
    """Return the pieces that are usual in a group of countries, its own before everybody's."""
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
