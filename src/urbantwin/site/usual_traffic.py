"""Typical traffic of a place at midday, by road class, lanes, country and surroundings.

Guesses for an initial ``site.yaml`` without counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

__all__ = [
    "LANE_PER_HOUR",
    "OTHER_PER_HOUR",
    "CountryTraffic",
    "country_traffic",
    "usual_per_hour",
]

#: Vehicles per hour that a lane of a street brings, by OpenStreetMap's road class: annual average
#: daily traffic of the middle of each functional class's range in towns (arterials 7,000 to
#: 27,000, minor arterials 3,000 to 14,000, collectors 1,100 to 6,300, local streets 80 to 700:
#: FHWA, Highway Functional Classification Concepts, 2013, table 3-5), half of it in each direction,
#: 5 % of a day in an hour of midday, over the lanes that such streets usually have.
LANE_PER_HOUR = {
    "motorway": 800.0, "motorway_link": 250.0,
    "trunk": 300.0, "trunk_link": 200.0,
    "primary": 250.0, "primary_link": 175.0,
    "secondary": 175.0, "secondary_link": 125.0,
    "tertiary": 100.0, "tertiary_link": 75.0,
    "unclassified": 40.0, "road": 40.0, "residential": 25.0, "living_street": 12.0,
    "pedestrian": 12.0, "busway": 10.0, "service": 5.0, "track": 2.5, "steps": 8.0,
}  # fmt: skip
#: Vehicles per hour and lane of other road classes.
OTHER_PER_HOUR = 40.0

#: Share of motorcycles among motor vehicles: countries where it is a tenth or more, to 5 %, after
#: the registered fleets (WHO, Global Status Report on Road Safety 2018, country profiles; Taiwan:
#: Ministry of Transportation and Communications). In the other countries few of a fleet's
#: motorcycles are out at a time.
MOTORCYCLES = {
    "VN": 0.90, "MM": 0.80, "ID": 0.80, "KH": 0.75, "LA": 0.75, "NP": 0.75, "BF": 0.75,
    "IN": 0.70, "PK": 0.70, "BD": 0.60, "TW": 0.60, "LK": 0.55, "TH": 0.55, "PH": 0.55, "CO": 0.55,
    "DO": 0.55, "UG": 0.50, "RW": 0.50, "TZ": 0.50, "MY": 0.45, "KE": 0.40, "UY": 0.40, "PY": 0.40,
    "NG": 0.35, "CN": 0.30, "IR": 0.30, "BR": 0.25, "AR": 0.25, "PE": 0.25, "EC": 0.25, "BO": 0.25,
    "GR": 0.20, "IT": 0.15, "ES": 0.15, "SG": 0.15, "JP": 0.10, "KR": 0.10, "MX": 0.10, "PT": 0.10,
    "CY": 0.10, "MT": 0.10,
}  # fmt: skip
MOTORCYCLES_ELSEWHERE = 0.03
#: Share of all trips that is made by bicycle, to a hundredth (Goel et al., Cycling behaviour in 17
#: countries across 6 continents, Transport Reviews 42, 2022, and national travel surveys).
BICYCLES = {
    "NL": 0.27, "DK": 0.15, "JP": 0.12, "BE": 0.11, "DE": 0.10, "CN": 0.10, "SE": 0.09, "FI": 0.08,
    "HU": 0.08, "CH": 0.07, "AT": 0.07, "IN": 0.06, "NO": 0.05, "TW": 0.04, "IT": 0.04, "PL": 0.04,
    "CZ": 0.04, "SI": 0.04, "FR": 0.03, "AR": 0.03,
}  # fmt: skip
BICYCLES_ELSEWHERE = 0.02
#: Approximate fraction of all trips made by motor vehicle, to which cyclists are related.
MOTOR_TRIPS = 0.5
#: Trucks among motor vehicles of four wheels and more, in towns. Assumed.
TRUCKS = 0.04
#: Vans among cars and vans: goods vehicles of up to 3.5 t drive 8 % of the kilometres of motor
#: traffic in Germany (KBA, Verkehr in Kilometern, 2022), 18 % in Great Britain (DfT, Road Traffic
#: Estimates, 2022).
VANS = 0.10
#: Room that a motorcycle takes on the road, in cars (Indian Roads Congress 106, 1990, has 0.5 where
#: they are a tenth of the traffic; among many of their kind they ride side by side).
MOTORCYCLE_IN_CARS = 0.4
#: Buses per hour on each line that is mapped, one direction: one every quarter of an hour.
LINE_PER_HOUR = 4.0
#: Trams per hour on each line that is mapped, one direction: one every ten minutes, as most
#: networks run at midday on working days, where the line's ``interval`` says nothing.
TRAM_LINE_PER_HOUR = 6.0
#: Buses per hour at each stop, if stops are mapped and lines are not.
STOP_PER_HOUR = 3.0
#: Limits of a place, cars per hour: the capacity of a signalised junction is, for conflicting
#: streams, about 1,500 in all per lane (Highway Capacity Manual 2010, chapter 31, quick
#: estimation), with two lanes each.
MOST, LEAST = 3000.0, 60.0


@dataclass(frozen=True)
class CountryTraffic:
    """Composition of a country's traffic.

    Attributes:
        motorcycles: fraction of motorcycles among motor vehicles.
        bicycles: bicycles per motor vehicle.
    """

    motorcycles: float
    bicycles: float


def country_traffic(country: str) -> CountryTraffic:
    """Return the traffic composition of a country (ISO 3166-1 alpha-2; empty if unknown)."""
    bicycles = BICYCLES.get(country, BICYCLES_ELSEWHERE) / MOTOR_TRIPS
    return CountryTraffic(MOTORCYCLES.get(country, MOTORCYCLES_ELSEWHERE), bicycles)


def usual_per_hour(
    lanes: Mapping[str, float],
    *,
    country: str = "",
    bus_lines: int = 0,
    bus_stops: int = 0,
    trams: float = 0.0,
    walkers: float = 0.0,
) -> dict[str, int]:
    """Return the actors that enter a place per hour, by class.

    Args:
        lanes: number of lanes that lead in, by road class.
        country: ISO 3166-1 alpha-2; empty if unknown.
        bus_lines: mapped bus lines, per direction.
        bus_stops: mapped bus stops.
        trams: trams per hour on the mapped lines, over both directions.
        walkers: pedestrians per hour.
    """
    room = sum(LANE_PER_HOUR.get(kind, OTHER_PER_HOUR) * count for kind, count in lanes.items())
    cars = float(np.clip(room, LEAST, MOST))
    usual = country_traffic(country)
    share = usual.motorcycles
    # Number of motor vehicles that use the same road space as the cars.
    motor = cars / (1.0 - share + share * MOTORCYCLE_IN_CARS)
    buses = bus_lines * LINE_PER_HOUR or bus_stops * STOP_PER_HOUR
    found = {
        "car": motor * (1.0 - share) * (1.0 - TRUCKS) * (1.0 - VANS),
        "truck": motor * (1.0 - share) * TRUCKS,
        "bus": min(buses, cars / 6),
        "motorcycle": motor * share,
        "bicycle": cars * usual.bicycles,
        "pedestrian": walkers,
        "van": motor * (1.0 - share) * (1.0 - TRUCKS) * VANS,
        "tram": trams,
    }
    rounded = {name: _rounded(count) for name, count in found.items()}
    return {name: count for name, count in rounded.items() if count or name != "tram"}


def _rounded(count: float) -> int:
    """Return a count rounded to the precision of a guess."""
    step = 10 if count >= 100 else 5 if count >= 20 else 1
    return round(count / step) * step
