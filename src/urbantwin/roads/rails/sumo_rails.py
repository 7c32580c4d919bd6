"""Tracks as a part of SUMO's network that nothing else is connected to.

Each is an edge of one lane with the track's own line. Where tracks meet there are no lanes inside
the junction, so that trams stay on their rails to the centimetre.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import shapely
from lxml import etree

from urbantwin.roads.network import Track

__all__ = ["RAIL_M", "add_rails"]

#: Width of a tram's lane, metres: its clearance.
RAIL_M = 2.6


def add_rails(path: Path, tracks: Sequence[Track]) -> None:
    """Add tracks to a ``.net.xml``, rewritten in place.

    Args:
        path: the network.
        tracks: with the ids of those that follow each.
    """
    if not tracks:
        return
    tree = etree.parse(path, etree.XMLParser(remove_blank_text=True))
    root = tree.getroot()
    nodes = _nodes(tracks)
    groups: dict[str, list[etree._Element]] = {"edge": [], "junction": [], "connection": []}
    for track in tracks:
        start, end = nodes[track.id]
        groups["edge"].append(_edge(track, start, end))
    by_id = {track.id: track for track in tracks}
    into: defaultdict[str, list[Track]] = defaultdict(list)
    for track in tracks:
        into[nodes[track.id][1]].append(track)
    for name in sorted({node for ends in nodes.values() for node in ends}):
        entering = sorted(into[name], key=lambda track: track.id)
        links = [(one, by_id[n]) for one in entering for n in one.successors]
        ends = [track.line[-1] for track in entering]
        ends += [track.line[0] for track in tracks if nodes[track.id][0] == name]
        groups["junction"].append(_junction(name, ends[0][:2].tolist(), entering, links))
        groups["connection"] += [
            etree.Element(
                "connection",
                {"from": a.id, "to": b.id, "fromLane": "0", "toLane": "0"},
                dir="s",
                state="M" if len({x.id for x, y in links if y is b}) < 2 else "=",
            )
            for a, b in links
        ]
    for tag, items in groups.items():
        last = root.findall(tag)[-1:]
        place = root.index(last[0]) + 1 if last else len(root)
        for k, item in enumerate(items):
            root.insert(place + k, item)
    etree.indent(root, space=" ")
    tree.write(path, encoding="UTF-8", xml_declaration=True)


def _nodes(tracks: Sequence[Track]) -> dict[str, tuple[str, str]]:
    """Return the names of the nodes where each track begins and ends: the same where they meet."""
    parent: dict[str, str] = {}

    def top(name: str) -> str:
        while parent.setdefault(name, name) != name:
            name = parent[name]
        return name

    for track in tracks:
        for following in track.successors:
            a, b = top(f"{track.id}>"), top(f"<{following}")
            parent[max(a, b)] = min(a, b)
    ends = [(track.id, top(f"<{track.id}"), top(f"{track.id}>")) for track in tracks]
    tops = sorted({name for end in ends for name in end[1:]})
    number = {name: f"rails-{k + 1}" for k, name in enumerate(tops)}
    return {name: (number[a], number[b]) for name, a, b in ends}


def _edge(track: Track, start: str, end: str) -> etree._Element:
    edge = etree.Element(
        "edge", {"id": track.id, "from": start, "to": end}, priority="-1", type="railway.tram"
    )
    etree.SubElement(
        edge,
        "lane",
        id=f"{track.id}_0",
        index="0",
        allow="tram",
        speed=f"{track.speed:.2f}",
        length=f"{max(shapely.LineString(track.line[:, :2]).length, 0.1):.3f}",
        width=f"{RAIL_M:.2f}",
        shape=" ".join(f"{x:.3f},{y:.3f}" for x, y, _ in track.line.tolist()),
    )
    return edge


def _junction(
    name: str, point: list[float], entering: list[Track], links: list[tuple[Track, Track]]
) -> etree._Element:
    x, y = point
    kind = "priority" if links else "dead_end"
    item = etree.Element(
        "junction",
        id=name,
        type=kind,
        x=f"{x:.3f}",
        y=f"{y:.3f}",
        incLanes=" ".join(f"{track.id}_0" for track in entering),
        intLanes="",
        shape=f"{x - 0.1:.3f},{y:.3f} {x:.3f},{y + 0.1:.3f} {x + 0.1:.3f},{y:.3f}",
    )
    for k, (a, b) in enumerate(links):
        foes = [b is d and a is not c for c, d in links]
        # Where two tracks become one, who comes over the later of them waits.
        first = [foe and n < k for n, foe in enumerate(foes)]
        etree.SubElement(
            item, "request", index=str(k), response=_bits(first), foes=_bits(foes), cont="0"
        )
    return item


def _bits(flags: list[bool]) -> str:
    """Return flags as SUMO writes them: the first is the last character."""
    return "".join("1" if flag else "0" for flag in reversed(flags))
