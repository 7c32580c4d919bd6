"""Signal programs of an imported map in SUMO's network, and their assignment to signals."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from lxml import etree
from numpy.typing import NDArray

from urbantwin.roads.imported.edges import Nodes
from urbantwin.roads.model import LaneModel, RoadSignal, SignalController

__all__ = ["lights_of_model", "lights_of_places", "with_programs"]

#: Pedestrian signals (ASAM OpenDRIVE 1.8, signal catalogue of the country ``OpenDRIVE``).
ON_FOOT = ("1000002",)
#: Maximum distance of a pedestrian signal from its crossing, metres.
BESIDE_M = 15.0
#: Maximum distance of a signal from the end of its street, metres.
FARTHEST_M = 40.0
#: Maximum distance of a place in a plan from its junction, metres.
NEAREST_M = 40.0


@dataclass
class _Light:
    """A traffic light of the network.

    Attributes:
        of_lane, of_way, of_crossing: link indices of each lane, internal lane and crossing.
        places: crossing -> its centre line (N, 2).
        crossed: crossing -> edges that it leads over.
        from_edge, to_edge: vehicle link -> its incoming and outgoing edge.
    """

    of_lane: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    of_way: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    of_crossing: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    places: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    crossed: dict[str, set[str]] = field(default_factory=dict)
    from_edge: dict[int, str] = field(default_factory=dict)
    to_edge: dict[int, str] = field(default_factory=dict)

    @property
    def of_vehicles(self) -> list[int]:
        return sorted(self.from_edge)

    @property
    def count(self) -> int:
        groups = (*self.of_lane.values(), *self.of_crossing.values())
        return 1 + max((k for group in groups for k in group), default=-1)


def with_programs(
    model: LaneModel, nodes: Nodes, lights: Mapping[str, str], net: Path
) -> tuple[LaneModel, dict[str, object]]:
    """Write the map's signal programs into a network, and assign links to each signal.

    A map's program fits if the links of its signals include all links of the network's light: links
    of a lane pairwise, pedestrian signals by the nearest crossing. Otherwise an assumed program
    stays.

    Args:
        model: the lane model, with named lanes.
        nodes: its nodes.
        lights: node -> id of its traffic light.
        net: the ``.net.xml``, rewritten if programs are set.

    Returns:
        The model with programs, links and strips of its signals, and counts.
    """
    tree = etree.parse(net)
    light_of = _lights(tree.getroot())
    phases = {item.name: item for item in model.controllers if item.phases}
    pairs: dict[str, dict[int, int]] = defaultdict(dict)
    signals = []
    for signal in model.signals:
        node = node_of_signal(model, nodes, signal) if signal.dynamic else None
        program = lights.get(node or "", "")
        if program not in light_of:
            signals.append(signal)
            continue
        strip, links = _governed(model, signal, light_of[program])
        if len(links) == len(signal.links):
            pairs[program].update(zip(links, signal.links, strict=True))
        signals.append(
            dataclasses.replace(signal, program=program, links=tuple(links), strip=strip)
        )
    fitting = [
        name
        for name, controller in phases.items()
        if name in light_of and _write_program(tree, name, controller, pairs[name], light_of[name])
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
    lights: dict[str, _Light] = defaultdict(_Light)
    for item in root.iterfind("connection"):
        program = item.get("tl")
        if program is None:
            continue
        light, index = lights[program], int(item.get("linkIndex"))
        if item.get("from").startswith(":"):
            light.of_crossing[f"{item.get('to')}_{item.get('toLane')}"].append(index)
            continue
        light.of_lane[f"{item.get('from')}_{item.get('fromLane')}"].append(index)
        light.from_edge[index], light.to_edge[index] = item.get("from"), item.get("to")
        if item.get("via"):
            light.of_way[item.get("via")].append(index)
    crossings = {
        edge.find("lane").get("id"): edge
        for edge in root.iterfind("edge")
        if edge.get("function") == "crossing"
    }
    for light in lights.values():
        for lane in light.of_crossing:
            edge = crossings[lane]
            shape = edge.find("lane").get("shape").split()
            light.places[lane] = np.array([[float(v) for v in p.split(",")[:2]] for p in shape])
            light.crossed[lane] = set(edge.get("crossingEdges", "").split())
        for group in (light.of_lane, light.of_way, light.of_crossing):
            for links in group.values():
                links.sort()
    return dict(lights)


def _governed(model: LaneModel, signal: RoadSignal, light: _Light) -> tuple[str, list[int]]:
    """Return the strips of a signal, separated by spaces, and its links."""
    road = model.road_by_id[signal.road]
    if signal.type.replace(".", "") in ON_FOOT:
        place = road.curve.beside([signal.s], [signal.t])[0]
        distance_of = {
            lane: float(np.linalg.norm(points[[0, -1]] - place, axis=1).min())
            for lane, points in light.places.items()
        }
        nearest = min(distance_of, key=lambda lane: (distance_of[lane], lane), default="")
        if nearest and distance_of[nearest] <= BESIDE_M:
            return nearest, light.of_crossing[nearest]
        return "", []
    if road.junction >= 0:
        first = [lane.strip.split()[0] for lane in road.sections[0].lanes if lane.strip]
        connections = [name for name in first if name in light.of_way]
        return " ".join(connections), _sorted_links(light.of_way, connections)
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
    return " ".join(lanes), _sorted_links(light.of_lane, lanes)


def _sorted_links(links: Mapping[str, list[int]], names: Iterable[str]) -> list[int]:
    return sorted({k for name in names for k in links[name]})


def _write_program(
    tree: etree._ElementTree,
    name: str,
    controller: SignalController,
    pairs: Mapping[int, int],
    light: _Light,
) -> bool:
    """Write a program of the map for a light and return whether it fits.

    Crossings without signals in the map have green while the crossed street has red.
    """
    logic = next(
        (program for program in tree.getroot().iterfind("tlLogic") if program.get("id") == name),
        None,
    )
    if logic is None:
        return False
    length, count = min(len(state) for _, state in controller.phases), light.count
    index_of = {k: v for k, v in pairs.items() if v < length}
    if not set(index_of) >= {k for links in light.of_lane.values() for k in links}:
        if length != count or any(index_of.get(k, k) != k for k in range(count)):
            return False
        index_of = {k: k for k in range(count)}
    for phase in list(logic.iterfind("phase")):
        logic.remove(phase)
    logic.set("offset", f"{controller.offset:g}")
    for seconds, state in controller.phases:
        shown = {k: state[v] for k, v in index_of.items()}
        for crossing, links in light.of_crossing.items():
            for k in links:
                if k not in index_of:
                    shown |= _walk(light, crossing, k, shown, clearing="y" in state)
        text = "".join(shown.get(k, "r") for k in range(count))
        etree.SubElement(logic, "phase", duration=f"{seconds:g}", state=text)
    etree.indent(logic, space=" ", level=1)
    return True


def _walk(
    light: _Light, crossing: str, link: int, shown: Mapping[int, str], *, clearing: bool
) -> dict[int, str]:
    """Return the states of a crossing and of turns over it, which yield while it has green."""
    crossed = light.crossed[crossing]
    before = [k for k in light.of_vehicles if light.from_edge[k] in crossed]
    turning_in = [k for k in light.of_vehicles if light.to_edge[k] in crossed]
    if clearing or any(shown.get(k, "r") not in "r" for k in before):
        return {link: "r"}
    return {link: "G", **{k: "g" for k in turning_in if shown.get(k) == "G"}}


def _controllers(
    model: LaneModel,
    root: etree._Element,
    signals: list[RoadSignal],
    lights: Mapping[str, str],
    nodes: Nodes,
) -> tuple[SignalController, ...]:
    """Return a controller for each traffic light, with its program in the network.

    A controller of the map without a program is only a group of signals; the light's program
    replaces it.
    """
    of_light: dict[str, list[int]] = defaultdict(list)
    for signal in signals:
        if signal.dynamic and signal.program:
            of_light[signal.program].append(signal.id)
    junctions_of: dict[str, list[int]] = defaultdict(list)
    for node, program in lights.items():
        junctions_of[program].append(nodes.junctions[node])
    id_of = {item.name: item.id for item in model.controllers}
    number = model.next_id
    controllers = []
    for logic in root.iterfind("tlLogic"):
        name = logic.get("id")
        if name not in junctions_of:
            continue
        identity = id_of.get(name, number)
        number += identity == number
        phases = tuple(
            (float(phase.get("duration")), str(phase.get("state")))
            for phase in logic.iterfind("phase")
        )
        controllers.append(
            SignalController(
                identity,
                name,
                tuple(of_light[name]),
                tuple(sorted(junctions_of[name])),
                float(logic.get("offset", 0)),
                phases,
            )
        )
    return tuple(controllers)


def lights_of_model(model: LaneModel, nodes: Nodes) -> dict[str, str]:
    """Return node -> id of its traffic light.

    Nodes of one signal program, as in maps written by UrbanTwin, are one light. Other nodes have
    their own light with the node's name.
    """
    light_of: dict[str, str] = {}
    at_junction = {junction: node for node, junction in nodes.junctions.items()}
    for signal in model.signals:
        node = node_of_signal(model, nodes, signal) if signal.dynamic else None
        if node is not None and (signal.program or node not in light_of):
            light_of[node] = signal.program or node
    dynamic = {signal.id for signal in model.signals if signal.dynamic}
    for controller in model.controllers:
        for junction in controller.junctions:
            if junction in at_junction and dynamic & set(controller.signals):
                node = at_junction[junction]
                light_of.setdefault(node, controller.name if controller.phases else node)
    return light_of


def lights_of_places(
    nodes: Nodes,
    outlines: Mapping[int, NDArray[np.float64]],
    places: Sequence[NDArray[np.float64]],
) -> dict[str, str]:
    """Return node -> id of a traffic light for the junctions nearest to places.

    Some maps lack signals that exist: a planned program for a place implies a traffic light.

    Args:
        nodes: the nodes of the lane model.
        outlines: junction -> its outline (M, 2).
        places: (2,) each, site frame, metres; those without a junction nearby are ignored.
    """
    areas = {
        node: shapely.Polygon(outlines[junction])
        for node, junction in nodes.junctions.items()
        if len(outlines.get(junction, ())) > 2
    }
    light_of: dict[str, str] = {}
    for place in places:
        distance_of = {
            node: shapely.distance(area, shapely.Point(place)) for node, area in areas.items()
        }
        node = min(distance_of, key=lambda name: (distance_of[name], name), default=None)
        if node is not None and distance_of[node] <= NEAREST_M:
            light_of[node] = node
    return light_of


def node_of_signal(model: LaneModel, nodes: Nodes, signal: RoadSignal) -> str | None:
    """Return the node whose traffic a signal applies to; ``None`` if there is none."""
    road = model.road_by_id.get(signal.road)
    if road is None:
        return None
    if road.junction >= 0:
        by_junction = {junction: node for node, junction in nodes.junctions.items()}
        return by_junction.get(road.junction)
    end = {"+": "end", "-": "start"}.get(signal.orientation)
    if end is None:
        end = "end" if signal.s > road.length / 2 else "start"
    distance_m = abs((road.length if end == "end" else 0.0) - signal.s)
    node = nodes.of_end[road.id, end]
    return node if distance_m <= FARTHEST_M and node in nodes.junctions else None
