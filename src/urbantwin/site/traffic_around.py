"""Traffic estimates from a map: entering streets, bus and tram lines, pedestrians."""

from __future__ import annotations

from collections import Counter, defaultdict

import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.number_text import finite_number
from urbantwin.site.access import is_driven
from urbantwin.site.country import country_of
from urbantwin.site.extract import Extract, OsmFeature
from urbantwin.site.extract_coverage import mapped_area
from urbantwin.site.junction_proposal import STREETS, way_lanes
from urbantwin.site.usual_traffic import TRAM_LINE_PER_HOUR, usual_per_hour

__all__ = ["lanes_leading_in", "per_hour_around", "walkers_around"]

#: Streets of these classes that end without continuation are cut by the extract's border; of other
#: classes only near the border, since they may be cul-de-sacs.
THROUGH = frozenset("motorway trunk primary secondary tertiary".split())
#: Largest distance of a cut street end from the border of the mapped area, metres.
RIM_M = 40.0
#: Distance around a region from which features attract pedestrians, metres.
AROUND_M = 50.0
#: Walks to and from a feature, per hour at midday. Assumed.
VISITS = {"shop": 12.0, "office": 8.0, "tourism": 10.0, "leisure": 5.0}
VISITS_AMENITY = {
    "restaurant": 20.0, "cafe": 20.0, "fast_food": 25.0, "bar": 10.0, "pub": 10.0, "bank": 15.0,
    "pharmacy": 15.0, "post_office": 20.0, "marketplace": 150.0, "school": 60.0, "college": 100.0,
    "university": 150.0, "hospital": 80.0, "clinic": 20.0, "library": 30.0,
    "place_of_worship": 10.0, "theatre": 20.0, "cinema": 40.0, "townhall": 40.0,
    "kindergarten": 15.0, "bus_station": 200.0,
}  # fmt: skip
VISITS_STATION, VISITS_ENTRANCE, VISITS_TRAM, VISITS_BUS = 300.0, 200.0, 40.0, 15.0
#: Walks per hour of the residents of 100 m2 of floor, an estimate: 2.3 people, 0.8 walks a day
#: each, 6 % of them in an hour at midday.
WALKS_OF_100_M2 = 0.11
#: Floors of a building without a number of levels.
FLOORS = 2.0
#: Limits of pedestrians per hour at a junction in a town.
FEWEST, MOST = 40.0, 1200.0


def per_hour_around(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> dict[str, int]:
    """Return a guess of the actors that enter a region per hour, by class."""
    features = extract.features(frame, region.buffer(AROUND_M))
    lanes = lanes_leading_in(extract, frame, region)
    stops = sum(feature.tags.get("highway") == "bus_stop" for feature in features)
    return usual_per_hour(
        lanes,
        country=country_of(frame.latitude, frame.longitude),
        bus_lines=_bus_lines(extract, frame, region),
        bus_stops=stops,
        trams=_trams(extract, frame, region),
        walkers=walkers_around(features),
    )


def lanes_leading_in(
    extract: Extract, frame: SiteFrame, region: shapely.Polygon
) -> dict[str, float]:
    """Return the number of lanes that lead into a region, by road class.

    A street leads in where it crosses the border, and where the extract ends before that. Streets
    closed to motor traffic do not count.
    """
    streets = [
        way for way in extract.highways() if way.tags["highway"] in STREETS and is_driven(way.tags)
    ]
    uses = Counter(
        node for way in streets for node in dict.fromkeys(way.nodes) if node in extract.nodes
    )
    rim = mapped_area(extract, frame).exterior
    found: defaultdict[str, float] = defaultdict(float)
    for way in streets:
        line = extract.way_line(way, frame)
        if len(line) < 2:
            continue
        kind = way.tags["highway"]
        crossed = shapely.intersection(shapely.LineString(line), region.exterior)
        places = float(len(shapely.get_coordinates(crossed)))
        known = [node for node in way.nodes if node in extract.nodes]
        for node, point in ((known[0], line[0]), (known[-1], line[-1])):
            end = shapely.Point(point)
            if uses[node] > 1 or known[0] == known[-1] or not region.contains(end):
                continue
            through = kind.removesuffix("_link") in THROUGH
            lost = node not in (way.nodes[0], way.nodes[-1])
            places += through or lost or shapely.distance(rim, end) < RIM_M
        # One-way streets lead in at about every second crossing of the border.
        found[kind] += places * way_lanes(way) / 2
    return {kind: count for kind, count in sorted(found.items()) if count}


def walkers_around(features: list[OsmFeature]) -> float:
    """Return the pedestrians per hour, from the features around."""
    walks = sum(_walks_to(feature) for feature in features)
    return min(max(walks, FEWEST), MOST)


def _walks_to(feature: OsmFeature) -> float:
    tags = feature.tags
    walks = sum(
        count for key, count in VISITS.items() if tags.get(key, "no") not in ("no", "vacant")
    )
    walks += VISITS_AMENITY.get(tags.get("amenity", ""), 0.0)
    if tags.get("railway") in ("station", "halt"):
        walks += VISITS_STATION
    elif tags.get("railway") in ("subway_entrance", "train_station_entrance"):
        walks += VISITS_ENTRANCE
    elif tags.get("railway") == "tram_stop":
        walks += VISITS_TRAM
    elif tags.get("highway") == "bus_stop":
        walks += VISITS_BUS
    if tags.get("building", "no") not in ("no", "garage", "garages", "shed", "roof", "industrial"):
        floors = finite_number(tags.get("building:levels")) or FLOORS
        walks += WALKS_OF_100_M2 * feature.geometry.area * min(floors, 60.0) / 100.0
    return walks


def _bus_lines(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> int:
    """Return the number of mapped bus lines through a region, per direction."""
    near = {
        way.id
        for way in extract.highways()
        if len(line := extract.way_line(way, frame)) > 1
        and region.intersects(shapely.LineString(line))
    }
    return sum(
        relation.tags.get("type") == "route"
        and relation.tags.get("route") in ("bus", "trolleybus")
        and any(kind == "w" and way in near for kind, way, _ in relation.members)
        for relation in extract.relations.values()
    )


def _trams(extract: Extract, frame: SiteFrame, region: shapely.Polygon) -> float:
    """Return the number of trams per hour on rails through a region, per direction.

    Uses the lines' ``interval``; rails at ground level without a mapped line have two directions.
    """
    near = {
        way.id
        for way in extract.ways.values()
        if way.tags.get("railway") in ("tram", "light_rail")
        and way.tags.get("tunnel", "no") == "no"
        and "service" not in way.tags
        and not way.tags.get("layer", "0").startswith("-")
        and len(line := extract.way_line(way, frame)) > 1
        and region.intersects(shapely.LineString(line))
    }
    lines = [
        relation.tags
        for relation in extract.relations.values()
        if relation.tags.get("type") == "route"
        and relation.tags.get("route") in ("tram", "light_rail")
        and any(kind == "w" and way in near for kind, way, _ in relation.members)
    ]
    if near and not lines:
        return 2 * TRAM_LINE_PER_HOUR
    return sum(60.0 / _interval_min(tags.get("interval", "")) for tags in lines)


def _interval_min(text: str) -> float:
    """Return minutes between departures: ``10``, ``00:10`` or ``00:10:00``, else the default."""
    parts = [finite_number(part) for part in text.split(":")]
    known = [part for part in parts if part is not None]
    minutes = 0.0
    if len(known) == len(parts):
        minutes = known[0] if len(known) == 1 else 60.0 * known[0] + known[1]
    return minutes if 1.0 <= minutes <= 120.0 else 60.0 / TRAM_LINE_PER_HOUR
