"""Traffic signals and signs: poles at the kerb, arms over the lanes, heads, plates."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import LabelledMesh
from urbantwin.roads.signals import Head, plate_of
from urbantwin.scene.placement import on_ground
from urbantwin.scene.solids import Assembly, GroundHeight, Solid, box, columns, rods, sweep

__all__ = ["NO_PLACE", "signal_mesh"]

#: Name of the count of heads that no pole can carry.
NO_PLACE = "signals without a place beside the carriageway, left out"
#: Minimum distance of poles from carriageways, and their depth in the ground, metres.
KERB_M, BURIED_M = 0.4, 0.3
#: Maximum length of an arm, and step of the search for its pole's position, metres.
REACH_M, STEP_M = 18.0, 0.2
#: Minimum height of objects over lanes (clearance of streets: RAS-Q, AASHTO: 4.3 to 4.5 m).
CLEAR_M = 4.2
#: Heads with pole positions closer than this share one pole, metres.
SHARED_M = 1.0
#: Distance of the heads of a pole from its axis, metres.
OFF_AXIS_M = 0.12
#: Maximum distance of the pole of a low head that extends over the carriageway, metres.
BRACKET_M = 1.5
#: Heads that no arm reaches are mounted on a wire between two poles (US MUTCD 2009, 4D.12 and
#: 4D.15: span wires), at most this far from each pole. Heads of one wire are within the second
#: distance of its line, metres.
SPAN_M, ON_WIRE_M = 80.0, 1.5
#: The wire is this much above its heads, metres.
WIRE_M = 0.5
#: Height of the middle of heads without a position beside the carriageway, above it, metres.
OVER_M = 5.7


@dataclass
class _Pole:
    """A pole: its base, and the heads mounted beside it or on arms."""

    foot: NDArray[np.float64]
    beside: list[Head] = field(default_factory=list)
    over: list[Head] = field(default_factory=list)
    wires: list[_Wire] = field(default_factory=list)


@dataclass
class _Wire:
    """A wire between two poles, and the heads mounted on it."""

    feet: tuple[NDArray[np.float64], NDArray[np.float64]]
    heads: list[Head]

    @property
    def top(self) -> float:
        """Height of the wire, metres."""
        return max(head.z + head.signal.height / 2 for head in self.heads) + WIRE_M

    def carries(self, head: Head) -> bool:
        """Return whether a head is on the wire's line, with the same heading as the others."""
        line = shapely.LineString(self.feet)
        away = line.distance(shapely.Point(head.x, head.y))
        return away < ON_WIRE_M and math.cos(head.heading - self.heads[0].heading) > 0.9


def signal_mesh(
    heads: Sequence[Head], *, ground_height: GroundHeight, carriageway: shapely.Geometry
) -> tuple[LabelledMesh, dict[str, int]]:
    """Build the signals and signs of the ground level.

    A head beside the carriageway has its own pole or shares one close to it. A head over the
    carriageway is mounted on an arm across the direction of its traffic. The arm is on the nearest
    such pole, or on a new pole at the kerb; if neither is possible, the head is mounted on a wire
    between two poles. No pole is on the carriageway, and nothing is low over it; signs without a
    possible pole are left out. Lights have the class ``other-object``, plates ``traffic-sign``,
    other parts ``pole``.

    Args:
        heads: signals and signs with their positions.
        ground_height: heights of the ground.
        carriageway: area without poles.

    Returns:
        The mesh, ``part`` 1, 2, ... per pole, and counts of objects built or left out.
    """
    notes: Counter[str] = Counter()
    taken = shapely.buffer(carriageway, KERB_M - 0.05)
    shapely.prepare(taken)
    here = [head for head in heads if head.level == 0]
    notes["signals and signs on bridges, left out"] = len(heads) - len(here)
    poles: list[_Pole] = []
    over = []
    for head in here:
        if shapely.contains_xy(taken, head.x, head.y):
            over.append(head)
        else:
            _pole_at(poles, np.array([head.x, head.y])).beside.append(head)
    lanes = np.array([[head.x, head.y] for head in over]).reshape(-1, 2)
    wires: list[_Wire] = []
    for head, road in zip(over, ground_height(lanes), strict=True):
        clear = head.z - head.signal.height / 2 - float(road)
        if clear <= CLEAR_M:
            if bracket := _bracket(poles, head):
                bracket.beside.append(head)
                continue
            if not head.signal.dynamic:
                notes["signs without a place beside the carriageway, left out"] += 1
                continue
        high = head if clear > CLEAR_M else replace(head, z=float(road) + OVER_M)
        if pole := _pole_for_arm(poles, high, taken):
            pole.over.append(high)
        elif not _hung(wires, poles, high, taken):
            notes[NO_PLACE] += 1
    assembly = Assembly()
    feet = np.array([pole.foot for pole in poles]).reshape(-1, 2)
    for foot, pole in zip(on_ground(feet, ground_height(feet)), poles, strict=True):
        _add(assembly, foot, pole, notes)
    for wire in wires:
        _add_wire(assembly, wire, notes)
    return assembly.mesh(), {name: count for name, count in sorted(notes.items()) if count}


def _pole_at(poles: list[_Pole], xy: NDArray[np.float64]) -> _Pole:
    near = [(float(np.hypot(*(pole.foot - xy))), k) for k, pole in enumerate(poles)]
    if near and min(near)[0] < SHARED_M:
        return poles[min(near)[1]]
    poles.append(_Pole(xy))
    return poles[-1]


def _pole_for_arm(poles: list[_Pole], head: Head, taken: shapely.Geometry) -> _Pole | None:
    """Return the pole for a head on an arm: an existing pole abreast of it or a new one."""
    at = np.array([head.x, head.y])
    ahead = np.array([math.cos(head.heading), math.sin(head.heading)])
    across = np.array([-ahead[1], ahead[0]])
    best: tuple[float, int] | None = None
    for k, pole in enumerate(poles):
        gap = pole.foot - at
        away = abs(float(gap @ across))
        if abs(float(gap @ ahead)) < SHARED_M and away < REACH_M and (not best or away < best[0]):
            best = (away, k)
    if best is not None:
        return poles[best[1]]
    steps = np.arange(STEP_M, REACH_M, STEP_M)
    # Search on both sides, the nearer kerb first; the side of the traffic's direction first.
    sides = np.stack([at + steps[:, None] * across * side for side in (1, -1)], axis=1)
    points = sides.reshape(-1, 2)
    free = ~shapely.contains_xy(taken, points[:, 0], points[:, 1])
    return _pole_at(poles, points[np.argmax(free)]) if free.any() else None


def _bracket(poles: list[_Pole], head: Head) -> _Pole | None:
    """Return the pole beside the carriageway for a low head over its border."""
    near = [(float(np.hypot(*(pole.foot - [head.x, head.y]))), k) for k, pole in enumerate(poles)]
    return poles[min(near)[1]] if near and min(near)[0] < BRACKET_M else None


def _hung(wires: list[_Wire], poles: list[_Pole], head: Head, taken: shapely.Geometry) -> bool:
    """Mount a head on a wire; return whether there is ground for the wire's poles."""
    wire = next((wire for wire in wires if wire.carries(head)), None)
    if wire is not None:
        wire.heads.append(head)
        return True
    at = np.array([head.x, head.y])
    steps = np.arange(STEP_M, SPAN_M, STEP_M)[:, None]
    best: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None = None
    # Perpendicular to the traffic first, then oblique.
    for turn in np.radians([0.0, 15.0, -15.0, 30.0, -30.0, 45.0, -45.0, 60.0, -60.0]):
        across = np.array([-math.sin(head.heading + turn), math.cos(head.heading + turn)])
        ends = []
        for side in (1.0, -1.0):
            points = at + steps * across * side
            free = ~shapely.contains_xy(taken, points[:, 0], points[:, 1])
            if free.any():
                ends.append(points[np.argmax(free)])
        if len(ends) == 2:
            length = float(np.hypot(*(ends[0] - ends[1]))) * (1.0 + abs(turn))
            if best is None or length < best[0]:
                best = (length, ends[0], ends[1])
    if best is None:
        return False
    wire = _Wire((_pole_at(poles, best[1]).foot, _pole_at(poles, best[2]).foot), [head])
    for foot in wire.feet:
        _pole_at(poles, foot).wires.append(wire)
    wires.append(wire)
    return True


def _add(assembly: Assembly, foot: NDArray[np.float64], pole: _Pole, notes: Counter[str]) -> None:
    part = assembly.new_part()
    lit = [head for head in (*pole.beside, *pole.over) if head.signal.dynamic]
    tops = [head.z + 0.35 + head.signal.height / 2 for head in pole.beside]
    tops += [head.z + 0.25 for head in pole.over]
    tops += [wire.top + 0.25 for wire in pole.wires]
    height = max(tops) - foot[2]
    radius = 0.13 if pole.over or pole.wires else 0.07 if lit else 0.035
    mast = columns(foot - [0, 0, BURIED_M], height + BURIED_M, radius, radius * 0.75)
    assembly.add(mast, "pole", "metal-painted", part)
    for head in pole.over:
        _add_arm(assembly, foot, head, part)
    for head in pole.beside:
        if np.hypot(head.x - foot[0], head.y - foot[1]) > OFF_AXIS_M:
            _add_arm(assembly, foot, head, part)
    for head in (*pole.beside, *pole.over):
        if head.signal.dynamic:
            _add_lights(assembly, head, part)
            notes["traffic signal heads"] += 1
        else:
            _add_plate(assembly, head, part)
            notes["signs"] += 1
    notes["traffic signals" if lit or pole.wires else "sign posts"] += 1
    notes["arms over lanes"] += bool(pole.over)


def _add_arm(assembly: Assembly, foot: NDArray[np.float64], head: Head, part: int) -> None:
    """Add the arm to one head; arms to more distant heads of the same pole contain it."""
    start = np.array([foot[0], foot[1], head.z])
    behind = -OFF_AXIS_M * np.array([math.cos(head.heading), math.sin(head.heading), 0.0])
    end = np.array([head.x, head.y, head.z]) + behind
    thick, thin = (0.08, 0.05) if np.hypot(*(end - start)[:2]) > 1.0 else (0.03, 0.03)
    assembly.add(rods([start], [end], thick, thin, 6), "pole", "metal-painted", part)


def _add_wire(assembly: Assembly, wire: _Wire, notes: Counter[str]) -> None:
    """Add the wire between two poles and the heads on it."""
    part = assembly.new_part()
    ends = [np.array([foot[0], foot[1], wire.top]) for foot in wire.feet]
    assembly.add(rods([ends[0]], [ends[1]], 0.015, 0.015, 6), "pole", "metal-painted", part)
    for head in wire.heads:
        top = np.array([head.x, head.y, wire.top])
        assembly.add(
            rods([top], [top - [0.0, 0.0, wire.top - head.z]], 0.02, 0.02, 6),
            "pole",
            "metal-painted",
            part,
        )
        _add_lights(assembly, head, part)
        notes["traffic signal heads"] += 1
    notes["span wires"] += 1


def _add_lights(assembly: Assembly, head: Head, part: int) -> None:
    """Add a housing with its visors; at the pole's axis it is shifted towards its heading."""
    ahead = np.array([math.cos(head.heading), math.sin(head.heading), 0.0])
    across = np.array([-ahead[1], ahead[0], 0.0])
    tall, wide = head.signal.height, head.signal.width
    middle = np.array([head.x, head.y, head.z]) + OFF_AXIS_M * ahead
    housing = box(middle + 0.1 * ahead, [0.2, wide, tall], head.heading)
    along, length = ((0.0, 0.0, 1.0), tall) if tall >= wide else (tuple(across), wide)
    lights = max(2, round(length / 0.33))
    offsets = (np.arange(lights) - (lights - 1) / 2) * length / lights
    tops = middle + 0.28 * ahead + offsets[:, None] * np.array(along) + [0.0, 0.0, 0.13]
    visors = box(tops, [0.16, 0.24, 0.02], head.heading)
    solids: list[Solid] = [housing, visors]
    if length > 0.8:
        margin = 0.15
        solids.append(box(middle, [0.02, wide + 2 * margin, tall + 2 * margin], head.heading))
    for solid in solids:
        assembly.add(solid, "other-object", "metal-dark", part)


def _add_plate(assembly: Assembly, head: Head, part: int) -> None:
    """Add a sign's plate: a disc, an upright rectangle, an octagon or an inverted triangle."""
    ahead = np.array([math.cos(head.heading), math.sin(head.heading), 0.0])
    middle = np.array([head.x, head.y, head.z]) + 0.05 * ahead
    shape = plate_of(head.signal)
    if shape == "upright":
        plate = box(middle, [0.02, head.signal.width, head.signal.height], head.heading)
    else:
        corners, first = {"disc": (16, 0.0), "octagon": (8, 22.5), "triangle": (3, -90.0)}[shape]
        angle = np.radians(first + np.arange(corners) * 360.0 / corners)
        # Seen in the direction of the sign's heading, left is on the left.
        outline = head.signal.height / 2 * np.column_stack([np.cos(angle), np.sin(angle)])
        plate = sweep([middle - 0.01 * ahead, middle + 0.01 * ahead], -outline * [1, -1])
    assembly.add(plate, "traffic-sign", "retroreflector", part)
