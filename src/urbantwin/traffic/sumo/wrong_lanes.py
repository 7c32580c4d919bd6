"""Drivers who stand at the end of a lane that does not lead where they want to go.

Where two want to change into each other's place on a short street, both wait for ever, and
everybody behind them. People go on where their lane leads, and find their way from there. Part of
the worker: imports nothing of UrbanTwin.
"""

from __future__ import annotations

import libsumo

#: Who halts for longer, seconds, goes on along its lane: so near to its end, metres, and elsewhere,
#: where somebody may still make room.
PATIENCE_S, NEAR_M, LONG_S = 30.0, 15.0, 90.0
#: The way back is looked for to so many of the streets that were to come.
AHEAD = 12


def go_on(name: str, halt_s: float) -> None:
    """Lead a vehicle that stands in a wrong lane along that lane and back to its way.

    Args:
        name: of the vehicle.
        halt_s: how long it has stood, seconds.
    """
    vehicle = libsumo.vehicle
    lane = vehicle.getLaneID(name)
    if halt_s < PATIENCE_S or not lane or lane.startswith(":") or vehicle.getStops(name, 1):
        return
    far = libsumo.lane.getLength(lane) - vehicle.getLanePosition(name) > NEAR_M
    if far and halt_s < LONG_S:
        return
    if any(one[0] == lane and one[4] for one in vehicle.getBestLanes(name)):
        return
    at, route = vehicle.getRouteIndex(name), vehicle.getRoute(name)
    # A vehicle that was told anything has a type of its own, which routes do not know.
    kind = vehicle.getTypeID(name).removesuffix(f"@{name}")
    best: tuple[float, tuple[str, ...]] | None = None
    for link in libsumo.lane.getLinks(lane):
        first = libsumo.lane.getEdgeID(link[0])
        if first.startswith(":") or vehicle.getVehicleClass(name) in libsumo.lane.getDisallowed(
            link[0]
        ):
            continue
        for rest in range(at + 1, min(at + 1 + AHEAD, len(route))):
            found = libsumo.simulation.findRoute(first, route[rest], kind)
            if found.edges and (best is None or found.travelTime < best[0]):
                best = found.travelTime, (*found.edges, *route[rest + 1 :])
    if best is not None:
        vehicle.setRoute(name, [route[at], *best[1]])
