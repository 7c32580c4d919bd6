"""Side lanes against the carriageway, the junctions and the tags that they come from."""

import itertools
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.ground import Elevation
from urbantwin.roads import build_roads
from urbantwin.roads.cross_section import MappedSegment, cross_section
from urbantwin.roads.marking.give_way import parking_bays
from urbantwin.roads.model import (
    Connection,
    Curve,
    LaneModel,
    LaneSection,
    ModelJunction,
    ModelRoad,
    Piece,
    Profile,
    RoadLink,
    SectionLane,
)
from urbantwin.roads.opendrive import read_opendrive, write_opendrive
from urbantwin.roads.side_lanes import add_side_lanes, is_island
from urbantwin.site import read_extract

HERE = SiteFrame(48.7, 9.18)
ZERO = Profile.constant(0.0)
RAISED = {"sidewalk": 0.15}


def built_of(path, tmp_path):
    """Return what is built of a map within 90 m of the anchor, where one drives on the right."""
    return build_roads(
        read_extract(path),
        HERE,
        shapely.Point(0, 0).buffer(90),
        Elevation.flat(),
        driving_side="right",
        out=tmp_path / "n.net.xml",
    )


def road(number, rows, *, length=100.0, y=0.0, x=0.0, heading=0.0, curvature=0.0, **fields):
    """A street of one section; rows are (id, kind, width, forward)."""
    lanes = tuple(
        SectionLane(
            i, kind, Profile.constant(w), forward, strip=f"{number}_{i}", height=RAISED.get(kind, 0)
        )
        for i, kind, w, forward in sorted(rows, reverse=True)
    )
    return ModelRoad(
        **{
            "id": number, "name": "", "kind": "residential", "ways": (number,), "junction": -1,
            "curve": Curve((Piece(x, y, heading, length, curvature),)), "offset": ZERO,
            "elevation": ZERO, "bank": ZERO, "crown": ZERO,
            "sections": (LaneSection(0.0, lanes),), **fields,
        }
    )  # fmt: skip


TWO_WAY = [
    (2, "sidewalk", 2.5, False), (1, "driving", 3.0, False),
    (-1, "driving", 3.0, True), (-2, "sidewalk", 2.5, True),
]  # fmt: skip


def segment(number, tags, points=((0, 0), (100, 0)), side="right"):
    section = cross_section(
        {"highway": "residential", **tags}, driving_side=side, sidewalks="both", country="DE"
    )
    return MappedSegment(number, np.array(points, float), section)


def junctions(*roads):
    """A model in which every road meets two others at either end."""
    links = {
        "predecessor": RoadLink("junction", 900),
        "successor": RoadLink("junction", 901),
    }
    others = [
        road(500 + k, TWO_WAY, y=2000.0 + 50 * k, predecessor=RoadLink("junction", j))
        for k, j in enumerate((900, 900, 901, 901))
    ]
    ends = (ModelJunction(900, "a", ()), ModelJunction(901, "b", ()))
    fixed = [ModelRoad(**{**vars_of(r), **links}) for r in roads]
    return LaneModel("right", (*fixed, *others), ends)


def vars_of(item):
    return {name: getattr(item, name) for name in item.__dataclass_fields__}


def strips(item):
    """Kind -> inner and outer borders (N, 2) sampled along the road, by strip."""
    found = {}
    for section, end in zip(item.sections, item.section_ends, strict=True):
        s = np.linspace(section.s, end, 40)
        for lane in section.lanes:
            inner, outer = (item.border(section, lane, s, outer=o) for o in (False, True))
            found.setdefault((lane.strip, lane.kind), []).append(np.column_stack([s, inner, outer]))
    return {key: np.vstack(parts) for key, parts in found.items()}


def assert_sound(item):
    for section in item.sections:
        left = [lane.id for lane in section.lanes if lane.id > 0]
        right = [lane.id for lane in section.lanes if lane.id < 0]
        assert left == list(range(len(left), 0, -1))
        assert right == list(range(-1, -len(right) - 1, -1))
    for section, end in zip(item.sections, item.section_ends, strict=True):
        s = np.linspace(0, end - section.s, 50)
        for lane in section.lanes:
            assert lane.width.at(s).min() > -1e-9
    for (a, b), s in zip(itertools.pairwise(item.sections), item.section_ends[:-1], strict=True):
        for lane in a.lanes:
            if lane.successor is None:
                assert lane.width.at(s - a.s)[0] == pytest.approx(0, abs=1e-9)
                continue
            after = b.by_id[lane.successor]
            assert (after.predecessor, after.strip) == (lane.id, lane.strip)
            for outer in (False, True):
                # Neither a step nor a kink where lanes go on.
                before = item.border(a, lane, [s - 1e-4, s], outer=outer)
                beyond = item.border(b, after, [s, s + 1e-4], outer=outer)
                assert beyond[0] == pytest.approx(before[1], abs=1e-4)
                assert np.diff(beyond)[0] == pytest.approx(np.diff(before)[0], abs=1e-6)
        for lane in b.lanes:
            if lane.predecessor is None:
                assert lane.width.at(0.0)[0] == pytest.approx(0, abs=1e-9)


def test_parking_lies_between_carriageway_and_sidewalk():
    tags = {"parking:right": "lane", "parking:right:width": "2.2", "parking:left": "lane",
            "parking:left:orientation": "perpendicular"}  # fmt: skip
    model = junctions(road(1, TWO_WAY))
    done = add_side_lanes(model, [segment(1, tags)], country="DE")
    item = done.road_by_id[1]
    assert_sound(item)
    middle = item.section_at(50.0)
    assert [(lane.kind, round(float(lane.width.at(50 - middle.s)[0]), 2)) for lane in
            middle.lanes] == [("sidewalk", 2.5), ("parking", 5.0), ("driving", 3.0),
                              ("driving", 3.0), ("parking", 2.2), ("sidewalk", 2.5)]  # fmt: skip
    for (name, kind), line in strips(item).items():
        if kind == "driving":
            assert np.ptp(line[:, 1:], axis=0).max() < 1e-9
        if kind == "sidewalk":
            # The junction's corners stay where they are; the law keeps 5 m clear.
            ends = (line[:, 0] < 5.0) | (line[:, 0] > 95.0)
            assert np.abs(line[ends, 1]) == pytest.approx(3.0)
            depth = 5.0 if line[0, 1] > 0 else 2.2
            assert np.abs(line[:, 1]).max() == pytest.approx(3.0 + depth)
            assert name in ("1_2", "1_-2")
    names = [lane.strip for s in item.sections for lane in s.lanes if lane.kind == "parking"]
    assert all(name.split(":")[0] == "1" for name in names)
    assert done.road_by_id[500] == model.road_by_id[500]


@pytest.mark.parametrize(
    "tags",
    [
        {"parking:right": "lane", "parking:right:orientation": "diagonal"},
        {"parking:lane:right": "diagonal"},
    ],
)
def test_diagonal_parking_is_painted_so_and_comes_through_opendrive(tags, write_osm, tmp_path):
    nodes = {1: (-100, 0, {}), 2: (100, 0, {})}
    path = write_osm(nodes, {1: ([1, 2], {"highway": "residential", **tags})})
    built = built_of(path, tmp_path)
    (strip,) = (lane for lane in built.network.lanes if lane.kind == "parking")
    assert strip.parking == "diagonal"
    lines = np.array([line for _, line in parking_bays(built.model)])
    along = lines[:, 1] - lines[:, 0]
    # From the carriageway to the kerb, south of it, and eastwards, as its traffic goes.
    whole = np.abs(along[:, 1]) > 4.8
    assert whole.sum() > 20
    assert along[whole] == pytest.approx(np.tile([4.85, -4.85], (whole.sum(), 1)), abs=0.05)
    write_opendrive(built.model, HERE, tmp_path / "m.xodr", name="m")
    again = read_opendrive(tmp_path / "m.xodr").model
    assert {
        lane.parking for road in again.roads for part in road.sections for lane in part.lanes
        if lane.kind == "parking"
    } == {"diagonal"}  # fmt: skip


def test_a_way_drawn_against_the_road_has_its_sides_swapped():
    backwards = segment(1, {"parking:right": "lane"}, ((100, 0), (0, 0)))
    item = add_side_lanes(junctions(road(1, TWO_WAY)), [backwards]).road_by_id[1]
    assert [lane.id for lane in item.section_at(50).lanes if lane.kind == "parking"] == [2]


def test_each_way_of_a_road_has_its_own_parking():
    ways = [segment(1, {"parking:right": "lane"}, ((0, 0), (60, 0))), segment(2, {}, ((60, 0),
            (100, 0)))]  # fmt: skip
    item = add_side_lanes(junctions(road(1, TWO_WAY, ways=(1, 2))), ways).road_by_id[1]
    assert_sound(item)
    assert "parking" in {lane.kind for lane in item.section_at(40).lanes}
    assert "parking" not in {lane.kind for lane in item.section_at(61).lanes}


def test_parking_lies_within_a_cycle_track_and_beyond_a_cycle_lane():
    rows = [*TWO_WAY[:3], (-2, "bicycle", 2.0, True), (-3, "sidewalk", 2.5, True)]
    for value, expected in (
        ("track", ["driving", "parking", "bicycle", "sidewalk"]),
        ("lane", ["driving", "bicycle", "parking", "sidewalk"]),
    ):
        tags = {"parking:right": "lane", "cycleway:right": value}
        item = add_side_lanes(junctions(road(1, rows)), [segment(1, tags)]).road_by_id[1]
        assert_sound(item)
        assert [lane.kind for lane in item.section_at(50).lanes if lane.id < 0] == expected


def test_nobody_parks_at_crossings():
    model = junctions(road(1, TWO_WAY))
    ways = [segment(1, {"parking:both": "lane"})]
    item = add_side_lanes(model, ways, country="DE", crossings=[[40, 0.3]]).road_by_id[1]
    assert_sound(item)
    for s in np.linspace(35.01, 44.99, 9):
        assert "parking" not in {lane.kind for lane in item.section_at(float(s)).lanes}
    assert "parking" in {lane.kind for lane in item.section_at(25.0).lanes}


def test_roads_do_not_grow_into_others():
    beside = road(2, TWO_WAY, length=40.0, y=-12.0, x=30.0)
    model = junctions(road(1, TWO_WAY), beside)
    ways = [segment(1, {"parking:both": "lane"})]
    house = shapely.box(60, 6.5, 80, 20)
    item = add_side_lanes(model, ways, obstacles=[house]).road_by_id[1]
    assert_sound(item)
    for s in np.linspace(1, 99, 50):
        section = item.section_at(float(s))
        outer = {1: 0.0, -1: 0.0}
        for lane in section.lanes:
            side = 1 if lane.id > 0 else -1
            reach = float(item.border(section, lane, s, outer=True)[0])
            outer[side] = max(outer[side], abs(reach))
        if 62 < s < 78:
            assert outer[1] < 6.6
        if 32 < s < 68:
            assert outer[-1] < 6.6
    kinds = [[lane.kind for lane in item.section_at(s).lanes] for s in (20.0, 50.0, 90.0)]
    assert [row.count("parking") for row in kinds] == [2, 1, 2]


@pytest.mark.parametrize("gap", [1.0, 3.0, 7.0])
def test_a_median_fills_the_gap_of_a_dual_street(gap):
    one_way = [(-1, "driving", 3.5, True), (-2, "sidewalk", 2.5, True)]
    there = road(1, one_way)
    back = road(2, one_way, y=gap, x=100.0, heading=np.pi)
    done = add_side_lanes(junctions(there, back), [])
    total = 0.0
    for item in (done.road_by_id[1], done.road_by_id[2]):
        assert_sound(item)
        section = item.section_at(50.0)
        (median,) = (lane for lane in section.lanes if lane.kind == "median")
        assert (median.id, median.height) == (1, 0.15)
        total += float(median.width.at(50.0 - section.s)[0])
        lanes = {kind: line for (_, kind), line in strips(item).items() if kind == "driving"}
        assert lanes["driving"][:, 2].max() == pytest.approx(-3.5)
        nose = strips(item)[median.strip, "median"]
        assert nose[[0, -1], 2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert total == pytest.approx(gap, abs=0.02)


def test_carriageways_far_apart_or_side_by_side_share_no_median():
    one_way = [(-1, "driving", 3.5, True)]
    far = add_side_lanes(
        junctions(road(1, one_way), road(2, one_way, y=12.0, x=100.0, heading=np.pi)), []
    )
    touching = add_side_lanes(
        junctions(road(1, one_way), road(2, one_way, y=0.2, x=100.0, heading=np.pi)), []
    )
    for model in (far, touching):
        kinds = {lane.kind for r in model.roads for s in r.sections for lane in s.lanes}
        assert "median" not in kinds


def test_a_refuge_leads_both_directions_round_it():
    item = add_side_lanes(junctions(road(1, TWO_WAY)), [], islands=[[50.0, 0.0]]).road_by_id[1]
    assert_sound(item)
    section = item.section_at(50.0)
    (island,) = (lane for lane in section.lanes if lane.kind == "island")
    assert island.height == 0.15
    borders = [float(item.border(section, island, 50.0, outer=o)[0]) for o in (False, True)]
    assert borders == pytest.approx([1.0, -1.0])
    for (_, kind), line in strips(item).items():
        if kind == "driving":
            width = np.abs(line[:, 2] - line[:, 1])
            assert width == pytest.approx(3.0)
            assert np.abs(line[[0, -1], 1]).max() == pytest.approx(0.0, abs=1e-9)
    squeezed = add_side_lanes(
        junctions(road(1, TWO_WAY)), [], islands=[[50, 0]], obstacles=[shapely.box(0, 5.6, 100, 9)]
    )
    kinds = {lane.kind for s in squeezed.road_by_id[1].sections for lane in s.lanes}
    assert "island" not in kinds


@pytest.mark.parametrize("x", [-4.0, 3.0, 104.0])
def test_a_refuge_at_a_junction_stands_before_it(x):
    item = add_side_lanes(junctions(road(1, TWO_WAY)), [], islands=[[x, 0.0]]).road_by_id[1]
    assert_sound(item)
    (k,) = (k for k, s in enumerate(item.sections) if any(q.kind == "island" for q in s.lanes))
    first, last = item.sections[k].s, item.section_ends[k]
    assert 1.0 <= first < last <= 99.0
    assert min(abs(first - x), abs(last - x)) < 13.0
    for s in (0.0, 100.0):
        section = item.section_at(min(s, 99.99))
        reach = [float(item.border(section, q, s, outer=True)[0]) for q in section.lanes]
        assert reach == pytest.approx([5.5, 3.0, -3.0, -5.5])


@pytest.mark.parametrize(
    ("tags", "expected"),
    [
        ({"crossing:island": "yes"}, True),
        ({"traffic_calming": "island"}, True),
        ({"crossing": "uncontrolled;island"}, True),
        ({"crossing:island": "no", "crossing": "zebra"}, False),
    ],
)
def test_islands_of_the_map(tags, expected):
    assert is_island(tags) == expected


def test_links_through_junctions_follow_new_ids():
    """A shoulder that reaches the end of a road within a cycle track moves the track's id."""
    rows = [(-1, "driving", 3.5, True), (-2, "bicycle", 2.0, True)]
    first = road(1, rows, successor=RoadLink("junction", 9))
    second = road(2, rows, x=104.0, predecessor=RoadLink("junction", 9))
    ways = [
        MappedSegment(
            number,
            np.array([[x, 0.0], [x + 100, 0.0]]),
            cross_section(
                {"highway": "trunk", "oneway": "yes", "lanes": "1", "shoulder": "right",
                 "maxspeed": "100", "cycleway:right": "track"},
                driving_side="right", sidewalks="no",
            ),
        )
        for number, x in ((1, 0.0), (2, 104.0))
    ]  # fmt: skip
    links = {
        "predecessor": RoadLink("road", 1, "end"), "successor": RoadLink("road", 2, "start"),
    }  # fmt: skip
    over = road(3, [(-1, "bicycle", 2.0, True)], length=4.0, x=100.0, y=-3.5, junction=9, **links)
    lane = over.sections[0].lanes[0]
    lane = SectionLane(**{**vars_of(lane), "predecessor": -2, "successor": -2})
    over = ModelRoad(**{**vars_of(over), "sections": (LaneSection(0.0, (lane,)),)})
    junction = ModelJunction(9, "n", (Connection(1, 3, "start", ((-2, -1),)),))
    done = add_side_lanes(LaneModel("right", (first, second, over), (junction,)), ways)
    for number, k in ((1, -1), (2, 0)):
        section = done.road_by_id[number].sections[k]
        track = next(lane for lane in section.lanes if lane.kind == "bicycle")
        linked = done.road_by_id[3].sections[0].lanes[0]
        assert (linked.predecessor if number == 1 else linked.successor) == track.id
    (connection,) = done.junction_by_id[9].connections
    end = done.road_by_id[1].sections[-1]
    assert end.by_id[connection.links[0][0]].kind == "bicycle"


def test_a_mapped_refuge_is_built(write_osm, tmp_path):
    """From the map to a raised strip, an area on its road, and lanes of traffic beside it."""
    nodes = {1: (-100, 0, {}), 3: (100, 0, {})}
    nodes[2] = (0, 0, {"highway": "crossing", "crossing": "uncontrolled", "crossing:island": "yes"})
    path = write_osm(nodes, {1: ([1, 2, 3], {"highway": "secondary", "sidewalk": "both"})})
    built = built_of(path, tmp_path)
    areas = [area for area in built.model.areas if area.kind == "trafficIsland"]
    islands = []
    for area in areas:
        host = built.model.road_by_id[area.road]
        x, y, heading = host.curve.at(area.s)[0]
        turn = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
        islands.append(shapely.Polygon(area.corners[:, :2] @ turn.T + [x, y]))
        assert area.height == 0.15
        assert islands[-1].is_valid
        # People walk between its two halves.
        assert 1.0 < islands[-1].distance(shapely.Point(0, 0)) < 6.0
        assert islands[-1].bounds[3] - islands[-1].bounds[1] == pytest.approx(2.0, abs=0.02)
    island = shapely.union_all(islands)
    assert [one.centroid.x > 0 for one in islands] in ([True, False], [False, True])
    assert built.network.area_of(("island",), 0).symmetric_difference(island).area < 1.2
    assert built.network.area_of(("driving",), 0).intersection(island).area < 2.0
    (crossing,) = (lane for lane in built.network.lanes if lane.kind == "crossing")
    assert crossing.polygon.intersection(island).area < 0.01


@pytest.mark.parametrize("name", ["neukolln", "quad_intersection"])
def test_real_streets(name, real_roads):
    """Side lanes of a real place: sound, and no traffic runs over them."""
    built = real_roads(name).built
    found = {lane.kind for r in built.model.roads for s in r.sections for lane in s.lanes}
    assert {"parking"} | ({"median", "shoulder"} if name == "quad_intersection" else set()) <= found
    for item in built.model.roads:
        if item.junction < 0 and len(item.sections) > 1:
            assert_sound(item)
    network = built.network
    driven = network.area_of(("driving", "bus"), 0)
    for kind in ("parking", "median", "shoulder"):
        area = network.area_of((kind,), 0)
        assert shapely.intersection(area, driven).area <= 0.02 * area.area + 0.5
    names = [lane.id for lane in network.lanes]
    assert len(names) == len(set(names))


def test_a_curb_takes_its_width_from_the_sidewalk(write_osm, tmp_path):
    """Every sidewalk beside a carriageway has a curb of 15 cm; both keep the place of the two."""
    nodes = {1: (-100, 0, {}), 2: (100, 0, {})}
    path = write_osm(nodes, {1: ([1, 2], {"highway": "secondary", "sidewalk": "both"})})
    built = built_of(path, tmp_path)
    (item,) = (road for road in built.model.roads if road.junction < 0)
    for section in item.sections:
        for side in (1, -1):
            kinds = [
                section.by_id[k].kind for k in range(side, 9 * side, side) if k in section.by_id
            ]
            assert kinds[-2:] == ["curb", "sidewalk"]
            curb, walk = (section.by_id[side * k] for k in (len(kinds) - 1, len(kinds)))
            assert curb.height == walk.height == 0.15
            middle = (item.section_ends[-1] - section.s) / 2
            assert curb.width.at(middle)[0] == pytest.approx(0.15)
    lanes = ElementTree.parse(tmp_path / "n.net.xml").getroot().findall("edge/lane")
    mapped = {float(x.get("width")) for x in lanes if x.get("allow") == "pedestrian"}
    walks = [lane for lane in built.network.lanes if lane.kind == "sidewalk"]
    assert {round(lane.width + 0.15, 6) for lane in walks} == mapped
