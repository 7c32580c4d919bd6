"""A site's map for findings: streets, footways and features of the region."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.roads.build import NETWORK_CLASSES
from urbantwin.site import Extract, Site
from urbantwin.site.corrections import Correction
from urbantwin.site.extract import OsmFeature, Way
from urbantwin.site.extract_coverage import mapped_area
from urbantwin.site.junction_proposal import STREETS, MappedJunction, mapped_junctions
from urbantwin.weakness.finding import Spot, spot

__all__ = ["WALKED", "MappedSite", "MappedWay", "nearness"]

#: Ways for pedestrians only.
WALKED = frozenset("footway path pedestrian steps corridor".split())
#: Values of ``foot`` that allow pedestrians on a cycleway.
_FOOT_VALUES = ("yes", "designated", "permissive")
#: Distance from the anchor at which objects have half weight, metres.
_HALF_WEIGHT_M = 50.0


@dataclass(frozen=True, eq=False)
class MappedWay:
    """A way with its part in the region.

    Attributes:
        way: the way of the map.
        line: the whole line, site frame.
        inside: the part in the region.
    """

    way: Way
    line: shapely.LineString
    inside: shapely.Geometry

    @property
    def name(self) -> str:
        """Its name, or its class."""
        return self.way.tags.get("name") or self.way.tags["highway"].replace("_", " ")

    @property
    def weight(self) -> float:
        """Its weight: by length in the region, nearness and class."""
        of_class = STREETS.get(self.way.tags["highway"], (1.0, 1))[0]
        return float(self.inside.length * nearness(self.inside) * of_class**0.5)

    def spot(self, frame: SiteFrame) -> Spot:
        """Return a point on it."""
        parts = [part for part in shapely.get_parts(self.inside) if part.length > 0]
        longest = max(parts, key=lambda part: part.length, default=self.line)
        return spot(frame, longest, element=f"way/{self.way.id}", name=self.name)


@dataclass(frozen=True, eq=False)
class MappedSite:
    """A site and its map.

    Attributes:
        site: the site as written.
        extract: its map around the region, with the site's buildings and corrections.
        added: ids of ways and relations of the site's file of buildings, which are not in the map.
        corrections: the site's corrections.
    """

    site: Site
    extract: Extract
    added: frozenset[int] = frozenset()
    corrections: tuple[Correction, ...] = ()

    @property
    def frame(self) -> SiteFrame:
        """The site frame."""
        return self.site.frame

    @property
    def region(self) -> shapely.Polygon:
        """The region that is built, site frame."""
        return self.site.region

    @cached_property
    def features(self) -> list[OsmFeature]:
        """The features that touch the region."""
        return self.extract.features(self.frame, self.region)

    @cached_property
    def area(self) -> shapely.Polygon:
        """The area in which the extract is complete, site frame."""
        return mapped_area(self.extract, self.frame)

    @cached_property
    def streets(self) -> list[MappedWay]:
        """The streets of the region that become lanes, except those in tunnels."""
        return self._ways(
            osm_way
            for osm_way in self.extract.highways()
            if osm_way.tags["highway"] in NETWORK_CLASSES
            and osm_way.tags.get("area") != "yes"
            and osm_way.tags.get("tunnel", "no") in ("no", "building_passage")
        )

    @cached_property
    def footways(self) -> list[MappedWay]:
        """The ways of the region for pedestrians only, as lines."""
        return self._ways(
            osm_way
            for osm_way in self.extract.highways()
            if (
                osm_way.tags["highway"] in WALKED
                or (
                    osm_way.tags["highway"] == "cycleway"
                    and osm_way.tags.get("foot") in _FOOT_VALUES
                )
            )
            and osm_way.tags.get("area") != "yes"
            and osm_way.tags.get("indoor", "no") == "no"
            and osm_way.tags.get("tunnel", "no") in ("no", "building_passage")
        )

    @cached_property
    def junctions(self) -> Sequence[MappedJunction]:
        """The junctions of streets in the region."""
        return mapped_junctions(self.extract, self.frame, self.region)

    def _ways(self, ways: Iterable[Way]) -> list[MappedWay]:
        mapped = []
        for osm_way in ways:
            points = self.extract.way_line(osm_way, self.frame)
            if len(points) < 2:
                continue
            line = shapely.LineString(points)
            inside = shapely.intersection(line, self.region)
            if inside.length > 0:
                mapped.append(MappedWay(osm_way, line, inside))
        return mapped


def nearness(shape: shapely.Geometry) -> float:
    """Return the weight of an object by its distance from the anchor: 1 there, 0.5 at 50 m."""
    away = float(np.asarray(shapely.distance(shape, shapely.Point(0.0, 0.0))))
    return 1.0 / (1.0 + (away / _HALF_WEIGHT_M) ** 2)
