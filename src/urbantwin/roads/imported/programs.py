"""Signal programs: the map's own put into SUMO's network, and what each signal shows there."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.imported.lights import node_of_signal
from urbantwin.roads.imported.nodes import Nodes
from urbantwin.roads.model import LaneModel, RoadSignal, SignalController

__all__ = ["with_programs"]

#: Lights for people on foot (ASAM OpenDRIVE 1.8, signal catalogue of the country ``OpenDRIVE``).
ON_FOOT = ("1000002",)
#: A light for people on foot stands at most this far from the crossing that it is for, metres.
BESIDE_M = 15.0


@dataclass
class _Light:
    """A traffic light of the network: which lane, way or crossing each of its links is for."""

    of_lane: dict[str, list[int]]
    of_way: dict[str, list[int]]
    of_crossing: dict[str, list[int]]
    places: dict[str, NDArray[np.float64]]

    @property
    def count(self) -> int:
        groups = (*self.of_lane.values(), *self.of_crossing.values())
        return 1 + max((k for group in groups for k in group), default=-1)


def with_programs(
    model: LaneModel, nodes: Nodes, lights: Mapping[str, str], net: Path
) -> tuple[LaneModel, dict[str, object]]:
    """Put the map's signal programs into a network, and tell each signal what it shows.

    A map's program fits where every link of the network's light is found among its signals' links:
    links of one lane pair by pair, lights for people on foot with the nearest crossing. Where
    one does not fit, netconvert's program stays.

    Args:
        model: the lane model, its lanes named.
        nodes: its nodes.
        lights: node -> id of the traffic light there.
        net: the ``.net.xml``, rewritten where programs are set.

    Returns:
        The model with programs, links and strips of its signals, and what was counted.
    """
    tree = etree.parse(net)
    found = _lights(tree.getroot())
    phases = {item.name: item for item in model.controllers if item.phases}
    pairs: dict[str, dict[int, int]] = defaultdict(dict)
    signals = []
    for signal in model.signals:
        node = node_of_signal(model, nodes, signal) if signal.dynamic else None
        program = lights.get(node or "", "")
        if program not in found:
            signals.append(signal)
            continue
        strip, links = _governed(model, signal, found[program])
        if len(links) == len(signal.links):
            pairs[program].update(zip(links, signal.links, strict=True))
        signals.append(
            dataclasses.replace(signal, program=program, links=tuple(links), strip=strip)
        )
    fitting = [
        name
        for name, controller in phases.items()
        if name in found and _set(tree, name, controller, pairs[name], found[name].count)
    ]
    if fitting:
        text = etree.tostring(tree.getroot(), xml_declaration=True, encoding="UTF-8")
        net.write_bytes(text + b"\n")
    notes: dict[str, object] = {"signal_programs_of_the_map": len(fitting)}
    unused = sorted(set(phases) - set(fitting))
    if unused:
        notes["signal_programs_of_the_map_that_do_not_fit"] = unused
    controllers = _controllers(model, tree.getroot(), signals, lights, nodes)
    return dataclasses.replace(model, signals=tuple(signals), controllers=controllers), notes


def _lights(root: etree._Element) -> dict[str, _Light]:
    found: dict[str, _Light] = {}
    for item in root.iterfind("connection"):
        program = item.get("tl")
        if program is None:
            continue
        light = found.setdefault(
            program, _Light(defaultdict(list), defaultdict(list), defaultdict(list), {})
        )
        index = int(item.get("linkIndex"))
        if item.get("from").startswith(":"):
            light.of_crossing[f"{item.get('to')}_{item.get('toLane')}"].append(index)
        else:
            light.of_lane[f"{item.get('from')}_{item.get('fromLane')}"].append(index)
            if item.get("via"):
                light.of_way[item.get("via")].append(index)
    shapes = {
        lane.get("id"): lane.get("shape")
        for edge in root.iterfind("edge")
        if edge.get("function") == "crossing"
        for lane in edge.iterfind("lane")
    }
    for light in found.values():
        for lane in light.of_crossing:
            points = [[float(v) for v in p.split(",")[:2]] for p in shapes[lane].split()]
            light.places[lane] = np.array(points)
        for group in (light.of_lane, light.of_way, light.of_crossing):
            for links in group.values():
                links.sort()
    return found


def _governed(model: LaneModel, signal: RoadSignal, light: _Light) -> tuple[str, list[int]]:
    """Return the strip that a signal governs and the links that it shows."""
    road = model.road_by_id[signal.road]
    if signal.type.replace(".", "") in ON_FOOT:
        place = road.curve.beside([signal.s], [signal.t])[0]
        away = {
            lane: float(np.linalg.norm(points[[0, -1]] - place, axis=1).min())
            for lane, points in light.places.items()
        }
        nearest = min(away, key=lambda lane: (away[lane], lane), default="")
        if nearest and away[nearest] <= BESIDE_M:
            return nearest, light.of_crossing[nearest]
        return "", []
    if road.junction >= 0:
        ways = [
            lane.strip.split()[0] for lane in road.sections[0].lanes if lane.strip in light.of_way
            or (lane.strip and lane.strip.split()[0] in light.of_way)
        ]  # fmt: skip
        return (ways[0] if ways else ""), _all(light.of_way, ways)
    onward = signal.orientation == "+" or (
        signal.orientation not in ("+", "-") and signal.s > road.length / 2
    )
    section = road.sections[-1 if onward else 0]
    lanes = [
        lane.strip
        for lane in section.lanes
        if lane.strip in light.of_lane
        and lane.forward == onward
        and (not signal.lanes or lane.id in signal.lanes)
    ]
    return (lanes[0] if lanes else ""), _all(light.of_lane, lanes)


def _all(links: Mapping[str, list[int]], names: Iterable[str]) -> list[int]:
    return sorted({k for name in names for k in links[name]})


def _set(
    tree: etree._ElementTree,
    name: str,
    controller: SignalController,
    pairs: Mapping[int, int],
    count: int,
) -> bool:
    """Write a program of the map for a light; say whether it fits."""
    logic = next((x for x in tree.getroot().iterfind("tlLogic") if x.get("id") == name), None)
    length = min(len(state) for _, state in controller.phases)
    if logic is None:
        return False
    if set(pairs) != set(range(count)) or max(pairs.values()) >= length:
        if length != count or any(pairs.get(k, k) != k for k in range(count)):
            return False
        pairs = {k: k for k in range(count)}
    for phase in list(logic.iterfind("phase")):
        logic.remove(phase)
    logic.set("offset", f"{controller.offset:g}")
    for seconds, state in controller.phases:
        shown = "".join(state[pairs[k]] for k in range(count))
        etree.SubElement(logic, "phase", duration=f"{seconds:g}", state=shown)
    etree.indent(logic, space=" ", level=1)
    return True


def _controllers(
    model: LaneModel,
    root: etree._Element,
    signals: list[RoadSignal],
    lights: Mapping[str, str],
    nodes: Nodes,
) -> tuple[SignalController, ...]:
    """Return a controller for each traffic light, with the program that it has in the network.

    A controller of the map without a program is a group of signals that switch together; it goes,
    for its light's program says more.
    """
    of_light: dict[str, list[int]] = defaultdict(list)
    for signal in signals:
        if signal.dynamic and signal.program:
            of_light[signal.program].append(signal.id)
    at: dict[str, list[int]] = defaultdict(list)
    for node, program in lights.items():
        at[program].append(nodes.junctions[node])
    known = {item.name: item.id for item in model.controllers}
    number = model.next_id
    found = []
    for logic in root.iterfind("tlLogic"):
        name = logic.get("id")
        if name not in at:
            continue
        identity = known.get(name, number)
        number += identity == number
        phases = tuple(
            (float(x.get("duration")), str(x.get("state"))) for x in logic.iterfind("phase")
        )
        found.append(
            SignalController(
                identity,
                name,
                tuple(of_light[name]),
                tuple(sorted(at[name])),
                float(logic.get("offset", 0)),
                phases,
            )
        )
    return tuple(found)
