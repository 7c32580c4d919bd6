"""A finding: the weak point, the twin's substitute, what to add, and where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
import yaml

from urbantwin.geometry import SiteFrame

__all__ = [
    "KINDS",
    "Finding",
    "Kind",
    "Matters",
    "Spot",
    "counted",
    "editor_link",
    "finding",
    "spot",
]

Matters = Literal["much", "some", "little"]

#: Least weight of a finding that matters much, and some.
_MUCH_WEIGHT, _SOME_WEIGHT = 0.35, 0.1


@dataclass(frozen=True)
class Kind:
    """A kind of finding.

    Attributes:
        weight: weight if everything of this kind is weak, 0 to 1.
        instead: the twin's substitute.
        remedy: what to add.
    """

    weight: float
    instead: str
    remedy: str


#: Kinds of findings by their names in the document.
KINDS: Mapping[str, Kind] = {
    name: Kind(**fields)
    for name, fields in yaml.safe_load(
        Path(__file__).with_name("kinds.yaml").read_text(encoding="utf-8")
    ).items()
}


@dataclass(frozen=True)
class Spot:
    """A place where something is to be added.

    Attributes:
        east_m: metres east of the anchor.
        north_m: metres north of the anchor.
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        element: element of the map, ``way/123``; empty if none.
        name: description of the object.
        link: address for the correction: a place in the OpenStreetMap editor.
    """

    east_m: float
    north_m: float
    latitude: float
    longitude: float
    element: str
    name: str
    link: str

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
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
    """A weak point.

    Attributes:
        kind: a key of `KINDS`.
        weight: weight, 0 to 1.
        problem: description.
        count: number of weak objects.
        of: number of all objects; 0 if there is nothing to count.
        spots: places, the nearest to the anchor first.
        where: field of ``site.yaml`` for the correction; empty if it is in the map.
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
        """Its weight in a word."""
        if self.weight >= _MUCH_WEIGHT:
            return "much"
        return "some" if self.weight >= _SOME_WEIGHT else "little"

    @property
    def instead(self) -> str:
        """The twin's substitute."""
        return KINDS[self.kind].instead

    @property
    def remedy(self) -> str:
        """What to add."""
        return KINDS[self.kind].remedy

    def as_json(self, number: int) -> dict[str, Any]:
        """Return it for JSON, with its number on the plan."""
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
            "places": [spot.as_json() for spot in self.spots],
        }


def counted(number: int, one: str, several: str) -> str:
    """Return a number with the singular or plural of what it counts."""
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
    """Return a finding with the weight of its kind times the weak share.

    Args:
        kind: a key of `KINDS`.
        problem: description.
        share: weak share, 0 to 1.
        count: number of weak objects.
        of: number of all objects.
        spots: places, in any order.
        where: field of ``site.yaml``.
    """
    ordered = sorted(
        spots, key=lambda place: (round(place.east_m**2 + place.north_m**2, 3), place.element)
    )
    weight = KINDS[kind].weight * min(max(share, 0.0), 1.0)
    return Finding(kind, weight, problem, count, of, tuple(ordered), where)


def editor_link(latitude: float, longitude: float, element: str = "") -> str:
    """Return the address of a place in the editor iD, with an element of the map selected.

    Args:
        latitude: degrees, WGS84.
        longitude: degrees, WGS84.
        element: ``node/1``, ``way/1`` or ``relation/1``.
    """
    kind, _, number = element.partition("/")
    selected = f"&{kind}={number}" if number else ""
    return (
        f"https://www.openstreetmap.org/edit?editor=id{selected}"
        f"#map=19/{latitude:.6f}/{longitude:.6f}"
    )


def spot(frame: SiteFrame, shape: shapely.Geometry, *, element: str = "", name: str = "") -> Spot:
    """Return a point on an object in the site frame as a spot.

    Args:
        frame: the site frame.
        shape: geometry in the site frame.
        element: element of the map.
        name: description of the object.
    """
    point = shape
    if shape.geom_type == "LineString":
        point = shape.interpolate(0.5, normalized=True)
    elif shape.geom_type != "Point":
        point = shape.representative_point()
    xy = np.array([[point.x, point.y]])
    longitude, latitude = (float(value) for value in frame.lonlat_from_site(xy)[0])
    return Spot(
        float(point.x),
        float(point.y),
        latitude,
        longitude,
        element,
        name,
        editor_link(latitude, longitude, element),
    )
