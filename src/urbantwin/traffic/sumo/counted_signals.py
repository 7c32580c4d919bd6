"""Signal programs computed anew for counted traffic."""

from __future__ import annotations

import shutil
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

from lxml import etree

from urbantwin.roads import RoadNetwork, SignalProgram
from urbantwin.roads.assignment.movement_flows import IN_CARS
from urbantwin.roads.signals.default_programs import set_default_programs
from urbantwin.roads.signals.programs import set_programs
from urbantwin.site.signals import SignalPlan, SignalSpec
from urbantwin.site.yaml_document import read_document
from urbantwin.traffic.demand.demand import Demand
from urbantwin.twin import Twin

__all__ = ["flows_of_trips", "net_for_counts", "timing_told"]


def net_for_counts(twin: Twin, demand: Demand, hours: float, out: Path) -> Path:
    """Write the twin's network with programs for a counted demand, and return its path.

    Programs given by the site stay, and so do all those of an imported map.

    Args:
        twin: the twin.
        demand: the trips.
        hours: duration of the demand, hours.
        out: the file to write.
    """
    if twin.site.get("roads", {}).get("file"):
        return twin.net_path
    shutil.copyfile(twin.net_path, out)
    set_default_programs(out, flows=flows_of_trips(demand, hours), fixed=True)
    site = twin.folder / "site.yaml"
    document = read_document(site, kind="a twin's site")
    specs = twin.site.get("signals") or []
    plans = [SignalPlan(SignalSpec.model_validate(x), document, k) for k, x in enumerate(specs)]
    set_programs(out, plans, twin.frame)
    return out


def flows_of_trips(demand: Demand, hours: float) -> dict[tuple[str, str, str], float]:
    """Return cars per hour by three consecutive edges, as signal programs are computed from.

    Args:
        demand: the trips.
        hours: duration of the demand, hours.
    """
    flows: dict[tuple[str, str, str], float] = defaultdict(float)
    for trip in demand.trips:
        cars = IN_CARS.get(trip.actor_class, 0.0) / hours
        padded = (*trip.edges, "")
        for triple in zip(padded, padded[1:-1], padded[2:], strict=False):
            flows[triple[0], triple[1], triple[2]] += cars
    return {edges: cars for edges, cars in flows.items() if cars > 0}


def timing_told(net: Path, roads: RoadNetwork) -> tuple[RoadNetwork, dict[str, Any]]:
    """Return the lanes with the programs of a network, and the programs that differ.

    Returns:
        The lanes, and program -> new ``cycle_s`` and ``greens_s`` of its phases, and the old ones.
    """
    programs = []
    changed: dict[str, Any] = {}
    logics = {logic.get("id"): logic for logic in etree.parse(net).getroot().iterfind("tlLogic")}
    for program in roads.programs:
        logic = logics.get(program.id)
        if logic is None:
            programs.append(program)
            continue
        phases = tuple(
            (float(phase.get("duration", "0")), phase.get("state", ""))
            for phase in logic.iterfind("phase")
        )
        new = SignalProgram(program.id, float(logic.get("offset", "0")), phases)
        programs.append(new)
        if new.phases != program.phases:
            changed[program.id] = {**_timing(new), "were": _timing(program)}
    return replace(roads, programs=tuple(programs)), changed


def _timing(program: SignalProgram) -> dict[str, Any]:
    greens = [
        seconds
        for seconds, state in program.phases
        if set(state) & set("gG") and "y" not in state.lower()
    ]
    return {"cycle_s": sum(seconds for seconds, _ in program.phases), "greens_s": greens}
