"""The demand in SUMO's format: vehicle types, trips, halts at stops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lxml import etree

from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand, Trip
from urbantwin.traffic.demand.standing_gap import standing_gap_of
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS, GAP_SPREAD, IN_BENDS, IN_QUEUES
from urbantwin.traffic.sumo.halts import ends_of_halts

__all__ = ["types_of_reserve", "write_routes"]

#: Width of the stripes of SUMO's pedestrians, which also limits theirs, metres.
_STRIPE_M = 0.64
#: Dwell time of a bus at a stop, seconds (Transit Capacity and Quality of Service Manual 2013,
#: chapter 6: 15 s at a typical stop outside of city centres).
DWELL_S = 15.0
#: Dwell time of a tram, with more doors and passengers, seconds (the same: 30 s and less for most
#: stops of streetcars).
TRAM_DWELL_S = 20.0
_LONG_S = 1e6  # longer than any simulation: the wait ends when the passenger boards
_USUAL_GAP_M = 2.5  # SUMO's default


def write_routes(path: Path, demand: Demand, asset: Callable[[str], Asset]) -> None:
    """Write the demand in SUMO's format: vehicle types, then the trips.

    A vehicle type is an asset with a gap at standstill, which SUMO takes from the type alone.
    """
    root = etree.Element("routes")
    types = _write_types(root, demand, asset)
    # SUMO requires the order of departure.
    for number, trip in sorted(
        enumerate(demand.trips), key=lambda numbered_trip: numbered_trip[1].depart_s
    ):
        if trip.beside:  # SUMO simulates only the leader of a group
            continue
        common = {"id": str(number), "type": types[number], "depart": f"{trip.depart_s:.2f}"}
        edges = " ".join(trip.edges)
        if trip.actor_class == "pedestrian":
            person = etree.SubElement(root, "person", **common, departPos=f"{trip.depart_m:.2f}")
            where = {"arrivalPos": f"{trip.arrive_m:.2f}", "departPosLat": "random"}
            etree.SubElement(person, "walk", edges=edges, **where)
            if 0 in trip.waits:
                _add_wait(person, trip.edges[-1], trip.arrive_m)
            for n, (further, arrive_m) in enumerate(trip.then, 1):
                where = {"arrivalPos": f"{arrive_m:.2f}"}
                etree.SubElement(person, "walk", edges=" ".join(further), **where)
                if n in trip.waits:
                    _add_wait(person, further[-1], arrive_m)
        else:
            how = {"departLane": "best", "departSpeed": "max", "departPos": "base"}
            if trip.anywhere:
                how = {"departLane": "best", "departSpeed": "max", "departPos": "random_free"}
            if trip.in_reserve:  # a gate adds the vehicle when needed
                vehicle = etree.SubElement(root, "route", id=f"route-{number}", edges=edges)
            else:
                vehicle = etree.SubElement(root, "vehicle", **common, **how)
                etree.SubElement(vehicle, "route", edges=edges)
            dwell_s = TRAM_DWELL_S if trip.actor_class == "tram" else DWELL_S
            for halt, end_m in ends_of_halts(trip.halts, demand.stops):
                where = {"busStop": str(halt), "endPos": f"{end_m:.2f}"}
                etree.SubElement(vehicle, "stop", **where, duration=f"{dwell_s:g}")
    etree.ElementTree(root).write(str(path), encoding="utf-8", xml_declaration=True)


def types_of_reserve(demand: Demand) -> dict[str, str]:
    """Return the vehicle type of each trip in reserve, by the trip's number as text."""
    return {
        str(number): _type_of(trip, demand)[0]
        for number, trip in enumerate(demand.trips)
        if trip.in_reserve
    }


def _write_types(root: etree._Element, demand: Demand, asset: Callable[[str], Asset]) -> list[str]:
    """Write the vehicle types; return the name of each trip's type."""
    types = [_type_of(trip, demand) for trip in demand.trips]
    kinds = {
        (trip.actor_class, trip.asset, *type_and_gap)
        for trip, type_and_gap in zip(demand.trips, types, strict=True)
    }
    for actor_class, name, type_name, gap_m in sorted(kinds):
        kind, mesh = ACTOR_KINDS[actor_class], asset(name)
        bounds = {"length": mesh.length, "width": mesh.width, "height": mesh.height}
        if actor_class == "pedestrian":  # a group's conflicts are resolved later
            bounds["width"] = min(mesh.width, _STRIPE_M)
        values = {attribute: f"{value:.3f}" for attribute, value in bounds.items()}
        values |= {**kind.parameters, **demand.manners.get(actor_class, {})}
        params = {key: values.pop(key) for key in (IN_BENDS, IN_QUEUES) if key in values}
        if values.pop(GAP_SPREAD, None) is not None:
            values["minGap"] = gap_m
        made = etree.SubElement(root, "vType", id=type_name, vClass=kind.vclass, **values)
        for key, value in params.items():
            etree.SubElement(made, "param", key=key, value=value)
    return [name for name, _ in types]


def _type_of(trip: Trip, demand: Demand) -> tuple[str, str]:
    """Return the name of a trip's vehicle type, and its gap at standstill, metres."""
    values = {
        **ACTOR_KINDS[trip.actor_class].parameters,
        **demand.manners.get(trip.actor_class, {}),
    }
    mean_m, spread_m = float(values.get("minGap", _USUAL_GAP_M)), float(values.get(GAP_SPREAD, 0))
    if spread_m <= 0:
        return trip.asset, f"{mean_m:g}"
    gap_m = f"{standing_gap_of(trip, mean_m, spread_m):.1f}"
    return f"{trip.asset}_{gap_m}", gap_m


def _add_wait(person: etree._Element, edge: str, at_m: float) -> None:
    """Add a wait that lasts until the process ends it."""
    etree.SubElement(person, "stop", edge=edge, endPos=f"{at_m:.2f}", duration=f"{_LONG_S:g}")
