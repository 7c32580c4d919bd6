"""The demand as SUMO reads it: types of vehicles, trips, halts at stops."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lxml import etree

from urbantwin.traffic.assets import Asset
from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.demand.manners import IN_BENDS, IN_QUEUES
from urbantwin.traffic.demand.vehicle_types import ACTOR_KINDS
from urbantwin.traffic.sumo.halts import ends_of_halts

__all__ = ["write_routes"]

#: SUMO's walkers keep to stripes of this width, and none may be wider, metres.
_STRIPE_M = 0.64
#: A bus halts at a stop for so long, seconds (Transit Capacity and Quality of Service Manual 2013,
#: chapter 6: 15 s at a typical stop outside of city centres).
DWELL_S = 15.0
#: A tram, with more doors and more people at each of its stops (the same: 30 s and less for most
#: stops of streetcars), for so long, seconds.
TRAM_DWELL_S = 20.0
_LONG_S = 1e6  # waiting has no end but the bus


def write_routes(path: Path, demand: Demand, asset: Callable[[str], Asset]) -> None:
    """Write the demand as SUMO reads it: one vehicle type per mesh, then the trips."""
    root = etree.Element("routes")
    for actor_class, name in sorted({(trip.actor_class, trip.asset) for trip in demand.trips}):
        kind, mesh = ACTOR_KINDS[actor_class], asset(name)
        bounds = {"length": mesh.length, "width": mesh.width, "height": mesh.height}
        if actor_class == "pedestrian":  # a dog beside is seen to when paths are parted
            bounds["width"] = min(mesh.width, _STRIPE_M)
        values = {attribute: f"{value:.3f}" for attribute, value in bounds.items()}
        values |= {**kind.parameters, **demand.manners.get(actor_class, {})}
        told = {key: values.pop(key) for key in (IN_BENDS, IN_QUEUES) if key in values}
        made = etree.SubElement(root, "vType", id=name, vClass=kind.vclass, **values)
        for key, value in told.items():
            etree.SubElement(made, "param", key=key, value=value)
    # SUMO wants them in the order of setting out.
    for number, trip in sorted(enumerate(demand.trips), key=lambda one: one[1].depart_s):
        if trip.beside:  # SUMO knows the one who leads
            continue
        common = {"id": str(number), "type": trip.asset, "depart": f"{trip.depart_s:.2f}"}
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
            vehicle = etree.SubElement(root, "vehicle", **common, **how)
            etree.SubElement(vehicle, "route", edges=edges)
            dwell_s = TRAM_DWELL_S if trip.actor_class == "tram" else DWELL_S
            for halt, end_m in ends_of_halts(trip.halts, demand.stops):
                where = {"busStop": str(halt), "endPos": f"{end_m:.2f}"}
                etree.SubElement(vehicle, "stop", **where, duration=f"{dwell_s:g}")
    etree.ElementTree(root).write(str(path), encoding="utf-8", xml_declaration=True)


def _add_wait(person: etree._Element, edge: str, at_m: float) -> None:
    """Add that somebody waits until it is told to walk on."""
    etree.SubElement(person, "stop", edge=edge, endPos=f"{at_m:.2f}", duration=f"{_LONG_S:g}")
