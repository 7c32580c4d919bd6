"""Vehicles that stand at the end of a lane that does not lead along their route.

Two vehicles on a short street that want each other's lane would wait for ever, and so would all
behind them. They continue along their lane and are rerouted from there. Part of the worker: imports
nothing of UrbanTwin.
"""

from __future__ import annotations

import libsumo

#: A vehicle that halts for longer than the first time, seconds, this near to the end of its lane,
#: metres, continues along it; elsewhere only after the second time, since a gap may still open.
PATIENCE_S, NEAR_M, LONG_S = 30.0, 15.0, 90.0
#: Number of the next edges of the route that the detour may rejoin.
AHEAD = 12


def go_on(name: str, halt_s: float) -> None:
    """Reroute a vehicle that stands in a wrong lane along that lane and back to its route.

    Args:
        name: name of the vehicle.
        halt_s: duration of its halt, seconds.
    """
    vehicle = libsumo.vehicle
    lane = vehicle.getLaneID(name)
    if halt_s < PATIENCE_S or not lane or lane.startswith(":") or vehicle.getStops(name, 1):
        return
    far = libsumo.lane.getLength(lane) - vehicle.getLanePosition(name) > NEAR_M
    if far and halt_s < LONG_S:
        return
    if any(lane_option[0] == lane and lane_option[4] for lane_option in vehicle.getBestLanes(name)):
        return
    route_index, route = vehicle.getRouteIndex(name), vehicle.getRoute(name)
    # A vehicle with own parameters has a type of its own, which ``findRoute`` does not know.
    kind = vehicle.getTypeID(name).removesuffix(f"@{name}")
    best: tuple[float, tuple[str, ...]] | None = None
    for link in libsumo.lane.getLinks(lane):
        first = libsumo.lane.getEdgeID(link[0])
        if first.startswith(":") or vehicle.getVehicleClass(name) in libsumo.lane.getDisallowed(
            link[0]
        ):
            continue
        for rest in range(route_index + 1, min(route_index + 1 + AHEAD, len(route))):
            detour = libsumo.simulation.findRoute(first, route[rest], kind)
            if detour.edges and (best is None or detour.travelTime < best[0]):
                best = detour.travelTime, (*detour.edges, *route[rest + 1 :])
    if best is not None:
        vehicle.setRoute(name, [route[route_index], *best[1]])
