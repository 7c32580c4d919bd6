"""A finding: what is weak, what the twin does instead, what to add, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

__all__ = ["KINDS", "Finding", "Kind", "Matters", "Spot", "counted", "finding"]

Matters = Literal["much", "some", "little"]

#: A finding of so much weight matters much, or some.
_MUCH, _SOME = 0.35, 0.1


@dataclass(frozen=True)
class Kind:
    """A kind of finding.

    Attributes:
        weight: how much it matters if all that can be weak in its way is, 0 to 1: about the share
            of a frame that is guessed then. A judgement, nothing measured.
        instead: what the twin has instead.
        remedy: what to add.
    """

    weight: float
    instead: str
    remedy: str


#: The kinds of findings by their names in the document.
KINDS: Mapping[str, Kind] = {
    "extract-ends": Kind(
        1.0,
        "streets end there, and nothing stands beyond",
        "take a larger extract, or a smaller region",
    ),
    "no-map": Kind(
        0.9,
        "nothing stands beside the roads",
        "give an OpenStreetMap extract as well (osm:)",
    ),
    "signals-missing": Kind(
        0.8,
        "traffic yields by the rank of its streets, and no poles of signals stand there",
        "if there are signals, map highway=traffic_signals on each approach",
    ),
    "sensors-proposed": Kind(
        0.7,
        "a place from which a sensor sees most of the junction is taken",
        "give the true places, heights and angles of the sensors in the rig",
    ),
    "dem-missing": Kind(
        0.6,
        "the ground is flat",
        "give an elevation model (dem:), or an airborne survey (geometry:)",
    ),
    "dem-coarse": Kind(
        0.3,
        "curbs, ramps and embankments are smoothed away",
        "give an elevation model of 1 m cells, or an airborne survey (geometry:)",
    ),
    "buildings-missing": Kind(
        0.5,
        "nothing stands beside the streets",
        "map the buildings, if there are any, with their heights",
    ),
    "building-heights": Kind(
        0.5,
        "heights are usual ones for the building's type",
        "add building:levels, or height in metres",
    ),
    "traffic-guessed": Kind(
        0.4,
        "how many come is guessed from the classes of the streets",
        "put counts into traffic.per_hour, or calibrate with a recording",
    ),
    "lanes": Kind(
        0.5,
        "the number of lanes is usual for the street's class",
        "add lanes (and lanes:forward, lanes:backward where they differ)",
    ),
    "turn-lanes": Kind(
        0.25,
        "which lane may turn where is guessed",
        "add turn:lanes (or turn:lanes:forward and :backward)",
    ),
    "crossings-missing": Kind(
        0.35,
        "people cross where the streets' corners suggest it",
        "if there is a crossing, map a node highway=crossing where it meets the street",
    ),
    "sidewalks": Kind(
        0.3,
        "whether there is a sidewalk is guessed from the street's class",
        "add sidewalk=both, left, right, no or separate, or map the footways",
    ),
    "footways-apart": Kind(
        0.25,
        "nobody walks from there to the rest",
        "join the footway's end with the way that it meets: one node in common",
    ),
    "footway-ends": Kind(
        0.2,
        "the way is closed there",
        "join the footway's end with the way that it meets: one node in common",
    ),
    "signal-programs": Kind(
        0.15,
        "cycles and greens are assumed by the streams that meet",
        "give the programs (signals:), if you know them",
    ),
    "trees-missing": Kind(
        0.25,
        "there are none",
        "map natural=tree, tree_row, or natural=wood",
    ),
    "lamps-missing": Kind(
        0.15,
        "lamps stand as they usually do, if scene.clutter is typical",
        "map highway=street_lamp and power=pole where they stand",
    ),
    "imagery-missing": Kind(
        0.15,
        "materials of the ground follow from tags and classes",
        "give an orthophoto (imagery:)",
    ),
    "imagery-old": Kind(
        0.2,
        "paint and surfaces are those of then",
        "give newer imagery, or look whether anything changed",
    ),
    "imagery-coarse": Kind(
        0.1,
        "paint cannot be told from asphalt",
        "give imagery of 0.2 m a pixel or finer",
    ),
    "surface": Kind(
        0.1,
        "streets are of asphalt",
        "add surface",
    ),
    "maxspeed": Kind(
        0.1,
        "the country's usual limit is taken",
        "add maxspeed",
    ),
    "licence": Kind(
        0.02,
        "whoever gets the twin is told that the terms are not stated",
        "add licence and attribution to the input",
    ),
}


@dataclass(frozen=True)
class Spot:
    """A place where something is to be added.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of it.
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        element: of the map, ``way/123``; empty where there is none.
        name: what is there, in words.
        link: where it is mended: a place in the OpenStreetMap editor.
    """

    east_m: float
    north_m: float
    latitude: float
    longitude: float
    element: str
    name: str
    link: str

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {
            "element": self.element,
            "name": self.name,
            "latitude": round(self.latitude, 7),
            "longitude": round(self.longitude, 7),
            "east_m": round(self.east_m, 1),
            "north_m": round(self.north_m, 1),
            "link": self.link,
        }


@dataclass(frozen=True)
class Finding:
    """Something that is weak.

    Attributes:
        kind: a key of `KINDS`.
        weight: how much it matters, 0 to 1.
        problem: what is weak, in words.
        count: how many are.
        of: of how many; 0 where there is nothing to count.
        spots: where, the nearest to the anchor first.
        where: the place in ``site.yaml`` where it is mended; empty where that is on the map.
    """

    kind: str
    weight: float
    problem: str
    count: int = 1
    of: int = 0
    spots: tuple[Spot, ...] = ()
    where: str = ""

    @property
    def matters(self) -> Matters:
        """How much it matters in a word."""
        if self.weight >= _MUCH:
            return "much"
        return "some" if self.weight >= _SOME else "little"

    @property
    def instead(self) -> str:
        """What the twin has instead."""
        return KINDS[self.kind].instead

    @property
    def remedy(self) -> str:
        """What to add."""
        return KINDS[self.kind].remedy

    def as_json(self, number: int) -> dict[str, Any]:
        """Return it as JSON holds it, with its number on the plan."""
        return {
            "number": number,
            "kind": self.kind,
            "matters": self.matters,
            "weight": round(self.weight, 3),
            "problem": self.problem,
            "count": self.count,
            "of": self.of,
            "instead": self.instead,
            "remedy": self.remedy,
            "where": self.where,
            "places": [one.as_json() for one in self.spots],
        }


def counted(number: int, one: str, several: str) -> str:
    """Return ``1 end lies`` or ``3 ends lie``: a number and what it counts, in words."""
    return f"{number} {one if number == 1 else several}"


def finding(
    kind: str,
    problem: str,
    *,
    share: float = 1.0,
    count: int = 1,
    of: int = 0,
    spots: Sequence[Spot] = (),
    where: str = "",
) -> Finding:
    """Return a finding; its weight is that of its kind times the share that is weak.

    Args:
        kind: a key of `KINDS`.
        problem: in words.
        share: 0 to 1.
        count: how many are weak.
        of: of how many.
        spots: where; they are put in order.
        where: the place in ``site.yaml``.
    """
    ordered = sorted(spots, key=lambda one: (round(one.east_m**2 + one.north_m**2, 3), one.element))
    weight = KINDS[kind].weight * min(max(share, 0.0), 1.0)
    return Finding(kind, weight, problem, count, of, tuple(ordered), where)
