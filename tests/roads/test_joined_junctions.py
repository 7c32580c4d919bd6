"""Junctions that lead directly into each other: SUMO finds the way through them."""

import itertools

import pytest
import shapely
import sumolib

from urbantwin.geometry import SiteFrame
from urbantwin.roads.imported import build_imported_roads, prepared_map
from urbantwin.roads.imported.read import read_map

FRAME = SiteFrame(50.0, 8.0)
EVERYTHING = shapely.Point(0.0, 0.0).buffer(500.0)
PIECE = 20.0


def lanes_of(first, last):
    """One lane each way; ``first`` and ``last``: what lane 1 and lane -1 are linked to."""

    def lane(number):
        links = f'<predecessor id="{first[number]}"/><successor id="{last[number]}"/>'
        return (
            f'<lane id="{number}" type="driving"><link>{links}</link>'
            '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
        )

    return (
        f'<lanes><laneSection s="0"><left>{lane(1)}</left><center><lane id="0" type="none"/>'
        f"</center><right>{lane(-1)}</right></laneSection></lanes>"
    )


def road(number, junction, x, length, before, after, *, turned=False, lanes=None):
    """A road on the x axis from x; ``turned``: its reference line runs to the west."""
    at, heading = (x + length, 3.141592653589793) if turned else (x, 0.0)
    ends = (after, before) if turned else (before, after)
    links = "".join(
        f'<{tag} elementType="{kind}" elementId="{other}"'
        + (f' contactPoint="{contact}"/>' if contact else "/>")
        for tag, end in zip(("predecessor", "successor"), ends, strict=True)
        if end
        for kind, other, contact in [end]
    )
    plain = {1: 1, -1: -1}
    return (
        f'<road name="" id="{number}" junction="{junction}" length="{length}"><link>{links}</link>'
        f'<planView><geometry s="0" x="{at}" y="0" hdg="{heading}" length="{length}"><line/>'
        f"</geometry></planView>{lanes or lanes_of(plain, plain)}</road>"
    )


def chain(count, *, by, turned=()):
    """Streets 1 and 2 with junctions 100, 101, ... between them, one road through each.

    Args:
        count: how many junctions.
        by: whether connecting roads are linked to the next ``road``, its ``junction``, or what
            the other of both is (``mixed``).
        turned: connecting roads that run against the others, by their number in the chain.
    """
    flip = {1: -1, -1: 1}
    plain = {1: 1, -1: -1}
    parts = [road(1, -1, -100, 100, None, ("junction", 100, ""))]
    names = [1, *(10 + k for k in range(count)), 2]
    against = {10 + k: k in turned for k in range(count)} | {1: False, 2: False}

    def start(name):
        return "end" if against[name] else "start"

    def end(name):
        return "start" if against[name] else "end"

    for k in range(count):
        before, name, after = names[k : k + 3]
        links = []
        for other, contact, junction in (
            (before, end(before), 99 + k),
            (after, start(after), 101 + k),
        ):
            inner = other not in (1, 2)
            kind = by if by != "mixed" else ("road", "junction")[(k + other) % 2]
            links.append(
                ("junction", junction, "")
                if inner and kind == "junction"
                else ("road", other, contact)
            )
        sides = [flip if against[name] != against[other] else plain for other in (before, after)]
        lanes = lanes_of(*(sides[::-1] if against[name] else sides))
        parts.append(
            road(name, 100 + k, k * PIECE, PIECE, *links, turned=against[name], lanes=lanes)
        )
    parts.append(road(2, -1, count * PIECE, 100, ("junction", 99 + count, ""), None))
    for k in range(count):
        before, name, after = names[k : k + 3]

        def connection(number, incoming, name, contact, lane):
            other = lane if against[incoming] == against[name] else -lane
            return (
                f'<connection id="{number}" incomingRoad="{incoming}" connectingRoad="{name}" '
                f'contactPoint="{contact}"><laneLink from="{lane}" to="{other}"/></connection>'
            )

        one = 1 if against[before] else -1
        two = -1 if against[after] else 1
        parts.append(
            f'<junction id="{100 + k}" name="">'
            + connection(0, before, name, start(name), one)
            + connection(1, after, name, end(name), two)
            + "</junction>"
        )
    return '<OpenDRIVE><header revMajor="1" revMinor="8"/>' + "".join(parts) + "</OpenDRIVE>"


def network(text, folder):
    path = folder / "map.xodr"
    path.write_text(text, encoding="utf-8")
    imported = read_map(path, FRAME, (0.0, 0.0))
    prepared = prepared_map(imported, EVERYTHING, None)
    out = folder / "network.net.xml"
    build_imported_roads(prepared, FRAME, out=out)
    return imported, prepared, sumolib.net.readNet(str(out))


def finds_a_way(net, start, end):
    path, _ = net.getShortestPath(net.getEdge(start), net.getEdge(end))
    return path is not None


@pytest.mark.parametrize("by", ["road", "junction", "mixed"])
@pytest.mark.parametrize(
    ("count", "turned"), [(1, ()), (2, ()), (2, (1,)), (2, (0,)), (3, ()), (3, (1,)), (4, (0, 2))]
)
def test_traffic_gets_through_a_chain_of_junctions_both_ways(tmp_path, count, turned, by):
    imported, prepared, net = network(chain(count, by=by, turned=turned), tmp_path)
    assert prepared.notes["left_out"] == []
    assert imported.notes["dropped"] == []
    assert len(imported.notes.get("junctions_joined_directly", [])) == count - 1
    assert finds_a_way(net, "1", "2")
    assert finds_a_way(net, "-2", "-1")
    # Nothing of the carriageway is lost or drawn twice.
    metres = sum(road.length for road in imported.model.roads)
    assert metres == pytest.approx(200 + count * PIECE)


@pytest.mark.parametrize("name", ["map.xodr", "map_road_links.xodr"])
def test_the_reported_map_is_whole(shared_data, tmp_path, name):
    text = (shared_data / "faults" / "03-connected-junctions" / name).read_text(encoding="utf-8")
    _, prepared, net = network(text, tmp_path)
    assert prepared.notes["left_out"] == []
    # Arms: 1 and 3 of the one junction, 2 and 4 of the other; roads 3 and 4 begin there.
    into, out = ("1", "-2", "-3", "-4"), ("-1", "2", "3", "4")
    joined = {
        (a, b) for a, b in itertools.product(into, out) if a.strip("-") != b.strip("-")
        and finds_a_way(net, a, b)
    }  # fmt: skip
    # By the map: straight on both ways, 3 to and from the west, 4 to and from the east.
    assert joined >= {("1", "2"), ("-2", "-1"), ("-3", "-1"), ("1", "3"), ("-4", "2"), ("-2", "4")}


def test_a_road_through_a_junction_may_be_in_pieces(tmp_path):
    """Two roads of one junction, one after the other, are one way through it."""
    text = chain(2, by="road").replace('junction="101"', 'junction="100"')
    text = text.replace('elementId="101"', 'elementId="100"')
    head, tail = text.split('<junction id="100" name="">')
    links = tail.replace('</junction><junction id="101" name="">', "")
    imported, prepared, net = network(f'{head}<junction id="100" name="">{links}', tmp_path)
    assert prepared.notes["left_out"] == []
    assert imported.notes["dropped"] == []
    assert finds_a_way(net, "1", "2")
    assert finds_a_way(net, "-2", "-1")
