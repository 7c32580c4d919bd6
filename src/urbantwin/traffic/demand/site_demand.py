"""The demand of a twin, as its site requests: counted, circulating, or passing through."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from urbantwin.roads.assignment.street_network import StreetNetwork
from urbantwin.traffic.demand.approaches import approaches_of
from urbantwin.traffic.demand.circulation import COMING_IN_S, Circulation
from urbantwin.traffic.demand.count_rates import is_counted
from urbantwin.traffic.demand.counts import counted_demand
from urbantwin.traffic.demand.demand import Bound, Demand, plan_demand, together
from urbantwin.traffic.demand.guessed_volumes import bounded_by_signals
from urbantwin.traffic.demand.passengers import with_passengers
from urbantwin.traffic.demand.platoons import in_platoons
from urbantwin.traffic.demand.time_of_day import at_time_of_day
from urbantwin.traffic.demand.vehicle_types import manners_of
from urbantwin.traffic.fleet_of_twin import fleet_of
from urbantwin.twin import Twin

__all__ = ["demand_of", "outer_roads"]

#: Length of road that a standing car takes, including the gap before it, metres.
CAR_SPACE_M = 7.0


def demand_of(
    twin: Twin,
    *,
    duration_s: float,
    seed: int,
    asked: Mapping[str, Any] | None = None,
    metered: bool = True,
) -> Demand:
    """Return the trips of a twin, as its site (or ``asked``) requests, over warm-up and duration.

    In a closed loop all actors enter during the warm-up and stay; gates meter how many pass per
    hour. Elsewhere traffic passes through.

    Args:
        twin: the twin.
        duration_s: duration of the motion after the warm-up.
        seed: random seed.
        asked: the site's ``traffic``, or another one in its form.
        metered: whether gates meter the inflow, as in `sumo.simulation`; without gates all vehicles
            depart at once.

    Raises:
        InputError: a counted place does not exist, or there are no counts at the time of day.
    """
    asked = at_time_of_day(asked or twin.site["traffic"])
    approaches = approaches_of(asked.get("approaches", ()), twin.roads)
    manners = manners_of(asked.get("drivers", {}))
    body = fleet_of(twin, seed).body
    in_groups = float(asked.get("in_groups", 0.0))
    if asked.get("counts"):
        return replace(
            _counted(twin, asked, duration_s, seed, body), manners=manners, approaches=approaches
        )
    network = StreetNetwork(twin.net_path, twin.region)
    circulation, bound = None, Bound()
    if twin.site.get("closed_loop"):
        circulation = Circulation(
            network,
            outer_roads(twin),
            asked["per_hour"],
            seed,
            stops=(*twin.roads.stops, *twin.roads.tram_stops),
            bus_roads=frozenset(twin.roads.bus_roads),
            in_groups=in_groups,
        )
        if asked.get("guessed"):
            circulation, bound = bounded_by_signals(twin.net_path, circulation)
    if circulation is not None and circulation.drives:
        warmup_s = float(asked["warmup_s"])
        demand = circulation.demand(
            circulation.populations() if metered else circulation.populations(at_once=1.0),
            warmup_s=warmup_s,
            duration_s=duration_s,
            body=body,
            room=_road_capacity(twin) if metered else None,
        )
        walks = circulation.walks
        if walks is not None and asked.get("passengers_per_halt"):
            demand = with_passengers(
                demand,
                twin.roads,
                walks,
                per_halt=float(asked["passengers_per_halt"]),
                seconds=warmup_s + duration_s,
                come_in_s=min(COMING_IN_S, warmup_s / 2),
                seed=seed,
                body=body,
            )
        return replace(demand, bound=bound, manners=manners, approaches=approaches)
    planned = plan_demand(
        network,
        asked["per_hour"],
        warmup_s=float(asked["warmup_s"]),
        duration_s=duration_s,
        seed=seed,
        body=body,
        in_groups=in_groups,
    )
    return replace(planned, manners=manners, approaches=approaches)


def _counted(
    twin: Twin,
    asked: Mapping[str, Any],
    duration_s: float,
    seed: int,
    body: Callable[[str, int], str],
) -> Demand:
    """Return the demand of a site with counts: all traffic passes through."""
    outer = outer_roads(twin) if twin.site.get("closed_loop") else frozenset()
    network = StreetNetwork(twin.net_path, twin.region, without=outer)
    counts, per_hour = asked["counts"], asked["per_hour"]
    warmup_s = float(asked["warmup_s"])
    counted = counted_demand(
        counts,
        twin.roads,
        network,
        per_hour,
        warmup_s=warmup_s,
        duration_s=duration_s,
        seed=seed,
        body=body,
        evenly=asked.get("counted_set_out") != "at_random",
    )
    counted = in_platoons(counted, asked.get("arrivals", ()), network, asked.get("drivers", {}))
    others = plan_demand(
        network,
        {name: rate for name, rate in per_hour.items() if not is_counted(name, counts)},
        warmup_s=warmup_s,
        duration_s=duration_s,
        seed=seed,
        body=body,
        in_groups=float(asked.get("in_groups", 0.0)),
    )
    return together(counted, others)


def outer_roads(twin: Twin) -> frozenset[str]:
    """Return the edges of outer roads, which belong to no OSM way, and of outer tracks.

    Networks whose roads are not made from OSM ways have no outer roads; vehicles turn round at
    their ends.
    """
    roads = twin.roads.roads
    rails = frozenset(track.id for track in twin.roads.tracks if track.outer)
    if not any(road.ways for road in roads):
        return rails
    return rails | frozenset(road.id for road in roads if not road.ways)


def _road_capacity(twin: Twin) -> dict[str, float]:
    """Return the number of cars that fit onto each road of the region bumper to bumper."""
    outer = outer_roads(twin)
    room: dict[str, float] = defaultdict(float)
    for lane in twin.roads.lanes:
        if lane.road and lane.road not in outer and "car" in lane.allowed:
            room[lane.road] += lane.length / CAR_SPACE_M
    return dict(room)
