"""A finding: what is weak, what the twin does instead, what to add, and where."""

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

#: A finding of so much weight matters much, or some.
_MUCH, _SOME = 0.35, 0.1


@dataclass(frozen=True)
class Kind:
    """A kind of finding.

    Attributes:
        weight: how much it matters if all that can be weak in its way is, 0 to 1.
        instead: what the twin has instead.
        remedy: what to add.
    """

    weight: float
    instead: str
    remedy: str


#: The kinds of findings by their names in the document.
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
    """Return the place of something in the site frame: a point that lies on it.

    Args:
        frame: the site frame.
        shape: in the site frame.
        element: of the map.
        name: what it is, in words.
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
