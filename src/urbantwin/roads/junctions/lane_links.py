"""Links between lanes through a junction, by arrows or else by lane order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from urbantwin.geometry import wrapped
from urbantwin.roads.junctions.passage import Passage
from urbantwin.roads.junctions.plain import PlainEdge, PlainLink, PlainNetwork
from urbantwin.roads.junctions.strip import heading_of

__all__ = ["Arrows", "lane_links"]

#: Edge id -> signed turns of each of its lanes, from the kerb inwards.
Arrows = Mapping[str, Sequence[tuple[str, ...]]]
#: Movements with at most this turn are straight on, radians.
STRAIGHT = np.radians(40.0)
#: Exits are compared at this distance along their lines, metres.
ONWARD_M = 15.0
#: Directions of arrows (OSM wiki, "Key:turn").
DIRECTIONS = {
    "left": "left", "sharp_left": "left", "slight_left": "left", "through": "through",
    "right": "right", "sharp_right": "right", "slight_right": "right", "reverse": "reverse",
    "merge_to_left": "through", "merge_to_right": "through",
}  # fmt: skip


def lane_links(
    plain: PlainNetwork, passages: Sequence[Passage], arrows: Arrows, *, driving_side: str
) -> dict[tuple[str, int, str, int], Passage]:
    """Return (edge, lane, edge, lane) -> passage, for all passages from one edge.

    Args:
        plain: the network, whose links determine the movements of unsigned lanes.
        passages: the passages from one edge.
        arrows: signed turns.
        driving_side: ``right`` or ``left``.
    """
    cycled = [p for p in passages if p.entry.is_cycle_track or p.exit.is_cycle_track]
    passages = [p for p in passages if p not in cycled]
    links = _cycled(cycled, driving_side)
    if not passages:
        return links
    entry = passages[0].entry
    cars = [k for k, lane in enumerate(entry.lanes) if lane.admits("passenger")]
    if not cars:
        cars = [k for k, lane in enumerate(entry.lanes) if lane.admits("bus")]
    kerb = driving_side
    words = _words(passages)
    signed = {k: _directions(arrows, entry, k) for k in cars}
    if any(signed.values()):
        words = _matched(passages, words, set().union(*signed.values()))
        users = _signed_users(cars, signed, words, kerb)
    else:
        users = _traced_users(plain, passages, cars, words, kerb)
    users = _untangled(passages, words, users, kerb)
    for passage, word, lanes in zip(passages, words, users, strict=True):
        way_out = passage.exit
        targets = [k for k, lane in enumerate(way_out.lanes) if lane.admits("passenger")]
        targets = targets or [k for k, lane in enumerate(way_out.lanes) if lane.admits("bus")]
        if targets:
            for k, j in _aligned(lanes, targets, word, kerb):
                links[entry.id, k, way_out.id, j] = passage
        _add_reserved_lanes(links, passage, word, cars, targets, kerb)
        _onto_cycle_lane(links, passage, lanes)
    return links


def _directions(arrows: Arrows, edge: PlainEdge, lane: int) -> set[str]:
    rows = arrows.get(edge.id, ())
    words = rows[lane] if lane < len(rows) else ()
    return {DIRECTIONS[word] for word in words if word in DIRECTIONS}


def _words(passages: Sequence[Passage]) -> list[str]:
    """Return left, through or right for each passage; a U-turn counts as an inner turn."""
    return [
        "through" if abs(p.turn) <= STRAIGHT else ("left" if p.turn > 0 else "right")
        for p in passages
    ]


def _matched(passages: Sequence[Passage], words: Sequence[str], signed: set[str]) -> list[str]:
    """Return the direction of each passage in terms of the signed ones, if that is unambiguous.

    Where streets meet at an angle, a signed turn may be almost straight, and vice versa.
    """
    directions = list(words)
    order = sorted(range(len(passages)), key=lambda k: -passages[k].turn)  # from left to right
    for word, ranked in (("left", order), ("right", order[::-1])):
        if word not in signed or word in directions:
            continue
        k = ranked[0]
        if sum(w == directions[k] for w in directions) > 1 or directions[k] not in signed:
            directions[k] = word
    if "through" in signed and "through" not in directions:
        spare = [
            k for k in order if directions.count(directions[k]) > 1 or directions[k] not in signed
        ]
        if spare:
            directions[min(spare, key=lambda k: abs(passages[k].turn))] = "through"
    return directions


def _signed_users(
    cars: Sequence[int], signed: Mapping[int, set[str]], words: Sequence[str], kerb: str
) -> list[list[int]]:
    """Return the lanes of each passage according to their arrows."""
    inner = "left" if kerb == "right" else "right"
    turns = {k: set(signed[k]) for k in cars}
    signed_turns = set().union(*turns.values())
    blank = [k for k in cars if not turns[k]]
    for k in blank:
        turns[k] = {"through"}
    # An unsigned outer lane may also turn to its side if no arrow shows that turn.
    if blank and cars[0] in blank and kerb not in signed_turns:
        turns[cars[0]].add(kerb)
    if blank and cars[-1] in blank and inner not in signed_turns:
        turns[cars[-1]].add(inner)
    users = [[k for k in cars if word in turns[k]] for word in words]
    served = {k for lanes in users for k in lanes}
    for k in sorted(set(cars) - served):
        # Its arrows lead nowhere: use the movements of the adjacent lane.
        adjacent = min(served, key=lambda j: (abs(j - k), j), default=None)
        for lanes in users:
            if adjacent is None or adjacent in lanes:
                lanes.append(k)
                lanes.sort()
    return users


def _traced_users(
    plain: PlainNetwork,
    passages: Sequence[Passage],
    cars: Sequence[int],
    words: Sequence[str],
    kerb: str,
) -> list[list[int]]:
    """Return the lanes of each passage according to the lane-to-lane links of the network."""
    users = []
    for passage, word in zip(passages, words, strict=True):
        lanes = [k for k in cars if _reaches_exit(plain, passage, k)]
        if not lanes:
            lanes = list(cars) if word == "through" else [cars[0] if word == kerb else cars[-1]]
        users.append(lanes)
    served = {k for lanes in users for k in lanes}
    for k in sorted(set(cars) - served):
        adjacent = min(served, key=lambda j: (abs(j - k), j))
        for lanes in users:
            if adjacent in lanes:
                lanes.append(k)
                lanes.sort()
    return users


def _untangled(
    passages: Sequence[Passage], words: Sequence[str], users: list[list[int]], kerb: str
) -> list[list[int]]:
    """Return the lanes of each passage, so that passages in one direction do not cross.

    Of two adjacent passages the straighter one keeps its lanes; the other gets the lanes beside.
    """
    outward = -1.0 if kerb == "right" else 1.0
    angles = [_exit_angle(passage) for passage in passages]
    order = sorted(range(len(passages)), key=lambda k: -outward * angles[k])  # from the kerb
    lanes_of = list(users)
    for number, nearer in enumerate(order):
        for farther in order[number + 1 :]:
            lanes = sorted({*lanes_of[nearer], *lanes_of[farther]})
            if words[nearer] != words[farther] or max(lanes_of[nearer]) <= min(lanes_of[farther]):
                continue
            if abs(angles[nearer]) <= abs(angles[farther]):
                lanes_of[farther] = [k for k in lanes if k >= max(lanes_of[nearer])]
                lanes_of[nearer] = [k for k in lanes if k <= lanes_of[farther][0]]
            else:
                lanes_of[nearer] = [k for k in lanes if k <= min(lanes_of[farther])]
                lanes_of[farther] = [k for k in lanes if k >= lanes_of[nearer][-1]]
    return lanes_of


def _exit_angle(passage: Passage) -> float:
    """Return the angle of the exit to the left of straight on, radians."""
    way_in, way_out = passage.entry.line, passage.exit.line
    end, beyond = way_in.interpolate(way_in.length), way_out.interpolate(ONWARD_M)
    chord = np.arctan2(beyond.y - end.y, beyond.x - end.x)
    return float(wrapped(chord - heading_of(way_in, at_end=True)))


def _reaches_exit(plain: PlainNetwork, passage: Passage, lane: int) -> bool:
    lanes = {lane}
    for edge, after in zip(passage.path, passage.path[1:], strict=False):
        lanes = {
            link.end_lane for link in _links_between(plain, edge, after) if link.start_lane in lanes
        }
    return bool(lanes)


def _links_between(plain: PlainNetwork, edge: PlainEdge, after: PlainEdge) -> list[PlainLink]:
    return [link for link in plain.links_from.get(edge.id, ()) if link.end == after.id]


def _aligned(
    lanes: Sequence[int], targets: Sequence[int], word: str, kerb: str
) -> list[tuple[int, int]]:
    """Return pairs of lanes: turns to the kerb side from the kerb, others from the inner side."""
    n, m = len(lanes), len(targets)
    if word == kerb:
        return [(k, targets[min(i, m - 1)]) for i, k in enumerate(lanes)]
    return [(k, targets[max(m - n + i, 0)]) for i, k in enumerate(lanes)]


def _cycled(passages: Sequence[Passage], kerb: str) -> dict[tuple[str, int, str, int], Passage]:
    """Return the links of passages that begin or end on a cycle track, one per passage.

    Cyclists use the lane nearest to the kerb that is open to them. For inner turns from a street
    without a cycle lane they start from the innermost lane.
    """
    inner = "left" if kerb == "right" else "right"
    links: dict[tuple[str, int, str, int], Passage] = {}
    for passage, word in zip(passages, _words(passages), strict=True):
        start = [k for k, lane in enumerate(passage.entry.lanes) if lane.admits("bicycle")]
        end = [k for k, lane in enumerate(passage.exit.lanes) if lane.admits("bicycle")]
        if start and end:
            on_cycle_lane = not passage.entry.lanes[start[0]].admits("passenger")
            k = start[-1] if word == inner and not on_cycle_lane else start[0]
            links[passage.entry.id, k, passage.exit.id, end[0]] = passage
    return links


def _onto_cycle_lane(
    found: dict[tuple[str, int, str, int], Passage], passage: Passage, lanes: Sequence[int]
) -> None:
    """Add a link onto a cycle lane for cyclists in mixed lanes, if no other link serves them."""
    entry, way_out = passage.entry, passage.exit
    shared = [k for k in lanes if entry.lanes[k].admits("bicycle")]
    open_lanes = [j for j, lane in enumerate(way_out.lanes) if lane.admits("bicycle")]
    ridden = any(
        (start, end) == (entry.id, way_out.id)
        and entry.lanes[k].admits("bicycle")
        and j in open_lanes
        for start, k, end, j in found
    )
    if shared and open_lanes and not ridden:
        found[entry.id, min(shared), way_out.id, open_lanes[0]] = passage


def _add_reserved_lanes(
    found: dict[tuple[str, int, str, int], Passage],
    passage: Passage,
    word: str,
    cars: Sequence[int],
    targets: Sequence[int],
    kerb: str,
) -> None:
    """Add the links of lanes that are closed to cars: bus and bicycle lanes.

    Lanes beside the kerb do not turn across car lanes, nor do lanes in the middle of the road. They
    stay on their side.
    """
    inner = "left" if kerb == "right" else "right"
    entry, way_out = passage.entry, passage.exit
    seen = set(cars)
    for name in ("bus", "bicycle"):
        users = [k for k, lane in enumerate(entry.lanes) if lane.admits(name) and k not in seen]
        exit_reserved = [
            j
            for j, other in enumerate(way_out.lanes)
            if other.admits(name) and not other.admits("passenger")
        ]
        seen |= set(users)
        for number, k in enumerate(users):
            in_the_middle = bool(cars) and k > max(cars)
            if word == (kerb if in_the_middle else inner):
                continue
            beside = [j for j in exit_reserved if not targets or (j > targets[-1]) == in_the_middle]
            shared = [j for j in targets if way_out.lanes[j].admits(name)]
            if beside:
                end = beside[min(number, len(beside) - 1)]
            elif shared or exit_reserved:
                end = (shared or exit_reserved)[-1 if in_the_middle else 0]
            else:
                continue
            found.setdefault((entry.id, k, way_out.id, end), passage)
