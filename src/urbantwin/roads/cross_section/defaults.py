"""Default lane counts and widths by class of road and country, where the map has none.

Sources. Germany: RASt 06 (urban streets: lanes 3.00 to 3.50 m on main streets, carriageways of
5.50 m in residential streets, cycle lanes 1.85 m, protective lanes 1.50 m, cycle tracks 2.00 m,
sidewalks 2.50 m, parallel parking 2.00 m, perpendicular 5.00 m, diagonal 4.85 m) and RAA (motorway
lanes 3.75 m, hard shoulder 2.50 m). United States and Canada: AASHTO, A Policy on Geometric Design
of Highways and Streets, 2018 (12 ft on freeways and high-speed arterials, 11 ft on urban arterials,
10 ft on local streets, shoulders of 10 ft on freeways, parking 7 to 8 ft), Guide for the
Development of Bicycle Facilities (5 ft). Australia and New Zealand: Austroads, Guide to Road Design
Part 3 (3.5 m, 3.3 m on urban arterials, shoulders 2.5 to 3.0 m on freeways), AS 2890.5 (parallel
parking 2.1 to 2.3 m). Taiwan: Urban Road and Accessory Works Design Standard (3.0 to 3.5 m lanes,
mixed or local lanes 2.8 to 3.0 m, cycle lanes 1.5 m, sidewalks at least 1.5 m of clear width).
United Kingdom: Manual for Streets, DMRB CD 127 (3.65 m, local streets 5.5 m). Japan: Road
Structure Ordinance, article 5 (3.0 to 3.5 m). Elsewhere: the middle of these.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Standard", "default_lanes", "standard_of"]

MOTORWAYS = frozenset({"motorway", "motorway_link", "trunk", "trunk_link"})
MAIN = frozenset(
    "primary primary_link secondary secondary_link tertiary tertiary_link busway".split()
)
#: Classes with two lanes per direction on one-way roads where nothing is mapped (OSM wiki,
#: "Key:lanes", assumptions).
WIDE_ONE_WAY = frozenset({"motorway", "trunk", "primary"})


@dataclass(frozen=True)
class Standard:
    """Default widths of a country's roads, metres."""

    motorway: float = 3.6
    main: float = 3.25
    local: float = 3.0
    bus: float = 3.25
    cycle_lane: float = 1.5
    advisory_lane: float = 1.5
    cycle_track: float = 1.8
    sidewalk: float = 2.5
    shoulder: float = 2.5
    minor_shoulder: float = 1.5
    parallel: float = 2.1
    diagonal: float = 4.6
    perpendicular: float = 5.0

    def lane(self, highway: str) -> float:
        """Return the width of a motor traffic lane of a class of road, metres."""
        if highway in MOTORWAYS:
            return self.motorway
        return self.main if highway in MAIN else self.local

    def parking(self, orientation: str) -> float:
        """Return the depth of parking of an orientation, metres."""
        return {"diagonal": self.diagonal, "perpendicular": self.perpendicular}.get(
            orientation, self.parallel
        )


GERMAN = Standard(
    3.75, 3.25, 2.75, 3.25, 1.85, 1.5, 2.0, 2.5, 2.5, 1.5, 2.0, 4.85, 5.0
)  # RASt 06, RAA
AMERICAN = Standard(3.6, 3.3, 3.0, 3.3, 1.5, 1.5, 1.8, 2.0, 3.0, 1.8, 2.3, 5.3, 5.5)
AUSTRALIAN = Standard(3.5, 3.3, 3.0, 3.3, 1.5, 1.5, 2.0, 2.0, 2.5, 1.5, 2.1, 4.6, 5.4)
BRITISH = Standard(3.65, 3.25, 2.75, 3.25, 2.0, 1.5, 2.0, 2.0, 3.3, 1.0, 2.0, 4.2, 4.8)
TAIWANESE = Standard(3.65, 3.25, 3.0, 3.25, 1.5, 1.5, 1.8, 2.5, 2.5, 1.2, 2.0, 4.5, 5.0)
JAPANESE = Standard(3.5, 3.25, 2.75, 3.25, 1.5, 1.5, 2.0, 2.5, 2.5, 0.75, 2.0, 4.5, 5.0)

STANDARDS = {
    **dict.fromkeys(("DE", "AT", "CH", "LI"), GERMAN),
    **dict.fromkeys(("US", "CA"), AMERICAN),
    **dict.fromkeys(("AU", "NZ"), AUSTRALIAN),
    **dict.fromkeys(("GB", "IE"), BRITISH),
    "TW": TAIWANESE,
    "JP": JAPANESE,
}


def standard_of(country: str) -> Standard:
    """Return the default widths of a country (ISO 3166-1 alpha-2; empty if unknown)."""
    return STANDARDS.get(country, Standard())


def default_lanes(highway: str, *, one_way: bool) -> int:
    """Return the number of lanes per direction where none is mapped."""
    if highway in ("motorway", "trunk"):
        return 2
    return 2 if one_way and highway in WIDE_ONE_WAY else 1
