"""Files of other makers, line by line, against closed forms; and what we write, read again."""

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Transformer
from scipy.special import fresnel

from urbantwin.geometry import SiteFrame
from urbantwin.roads.model import Curve
from urbantwin.roads.model.model import check_model
from urbantwin.roads.opendrive import placed, read_opendrive, write_opendrive
from urbantwin.roads.opendrive.reading.plan_view import polynomial_pieces, spiral_pieces
from urbantwin.roads.signals import pose_of

HERE = SiteFrame(48.7, 9.18)
CENTRE = '<center><lane id="0" type="none" level="false"/></center>'


def lane(number, kind="driving", width=3.5, inner=""):
    given = inner if "<width" in inner or "<border" in inner else ""
    width = given or f'<width sOffset="0" a="{width}" b="0" c="0" d="0"/>'
    rest = "" if given else inner
    return f'<lane id="{number}" type="{kind}" level="false">{width}{rest}</lane>'


def road(number="1", geometry="", lanes="", length=100.0, values='junction="-1"', **parts):
    """A road as text; ``parts``: link, type, elevation, lateral, offset, tail."""
    straight = f'<geometry s="0" x="0" y="0" hdg="0" length="{length}"><line/></geometry>'
    one = f'<laneSection s="0">{CENTRE}<right>{lane(-1)}</right></laneSection>'
    return (
        f'<road name="" length="{length}" id="{number}" {values}>{parts.get("link", "")}'
        f"{parts.get('type', '')}<planView>{geometry or straight}</planView>"
        f"<elevationProfile>{parts.get('elevation', '')}</elevationProfile>"
        f"<lateralProfile>{parts.get('lateral', '')}</lateralProfile>"
        f"<lanes>{parts.get('offset', '')}{lanes or one}</lanes>{parts.get('tail', '')}</road>"
    )


def whole(*roads, header='<header revMajor="1" revMinor="4"/>', root="<OpenDRIVE>"):
    return f'<?xml version="1.0"?>{root}{header}{"".join(roads)}</OpenDRIVE>'


@pytest.fixture
def read(tmp_path):
    """Return a function: roads as text -> what is read."""

    def run(*roads, **values):
        path = tmp_path / "map.xodr"
        path.write_text(whole(*roads, **values), encoding="utf-8")
        return read_opendrive(path)

    return run


def clothoid(s, first, last, length):
    """x, y at s of a clothoid from the origin, by Fresnel's integrals."""
    rate = (last - first) / length
    scale = math.sqrt(math.pi / abs(rate))
    sign = math.copysign(1, rate)
    start = first / rate  # where the curvature is zero lies at -start

    def at(q):
        b, a = fresnel(q / scale)
        return scale * a + 1j * sign * scale * b

    turn = first * start / 2
    z = (at(s + start) - at(start)) * np.exp(-1j * turn)
    return z.real, z.imag


@settings(max_examples=60, deadline=None)
@given(st.floats(-0.12, 0.12), st.floats(-0.12, 0.12), st.floats(2.0, 150.0))
def test_clothoids_become_cubics_within_a_tenth_of_a_millimetre(first, last, length):
    if abs(last - first) < 1e-4:
        last = first + 1e-3
    curve = Curve(tuple(spiral_pieces((0.0, 0.0, 0.0), length, first, last)))
    assert curve.length == pytest.approx(length)
    s = np.linspace(0, length, 301)
    x, y = clothoid(s, first, last, length)
    pose = curve.at(s)
    assert np.hypot(pose[:, 0] - x, pose[:, 1] - y).max() < 1e-4
    heading = first * s + (last - first) / length * s * s / 2
    assert np.abs(pose[:, 2] - heading).max() < 1e-3


def test_a_cubic_over_u_is_followed_by_its_length():
    a, b, c, d = 0.5, 0.1, 0.01, -1e-4
    curve = Curve(tuple(polynomial_pieces((10.0, 20.0, 0.0), 60.0, (a, b, c, d))))
    pose = curve.at(np.linspace(0, 60, 400))
    u, v = pose[:, 0] - 10, pose[:, 1] - 20
    assert np.abs(v - (a + b * u + c * u**2 + d * u**3)).max() < 1e-4
    fine = np.linspace(0, u[-1], 200001)
    slope = b + 2 * c * fine + 3 * d * fine**2
    assert np.trapezoid(np.hypot(1, slope), fine) == pytest.approx(60.0, abs=1e-3)


def test_every_shape_of_reference_line_is_where_the_standard_has_it(tmp_path, ruler):
    shapes = [
        "<line/>",
        '<arc curvature="0.02"/>',
        '<spiral curvStart="0.02" curvEnd="-0.03"/>',
        '<spiral curvStart="0.01" curvEnd="0.01"/>',
        '<paramPoly3 aU="0" bU="1" cU="0" dU="-1e-5" aV="0" bV="0" cV="0.004" dV="1e-5" '
        'pRange="arcLength"/>',
        '<paramPoly3 aU="0" bU="20" cU="0.1" dU="-0.1" aV="0" bV="0" cV="2" dV="-1" '
        'pRange="normalized"/>',
    ]
    text = "".join(
        f'<geometry s="{20 * k}" x="0" y="0" hdg="0" length="20">{shape}</geometry>'
        for k, shape in enumerate(shapes)
    )
    for k, shape in enumerate(shapes):
        single = f'<geometry s="0" x="{k}" y="7" hdg="{k - 2.5}" length="20">{shape}</geometry>'
        path = tmp_path / f"{k}.xodr"
        path.write_text(whole(road(geometry=single, length=20)), encoding="utf-8")
        curve = read_opendrive(path).model.roads[0].curve
        measure = ruler(path)[1]["1"]
        for s in np.linspace(0, 20, 23):
            x, y, heading = measure.reference(s)
            assert curve.at(s)[0, :2] == pytest.approx([x, y], abs=1e-4), shape
            turn = (curve.at(s)[0, 2] - heading + math.pi) % (2 * math.pi) - math.pi
            assert abs(turn) < 1e-3, shape
    assert text.count("<geometry") == 6


def borders(model):
    """Road and section and lane -> its outer border in space."""
    found = {}
    for item in model.roads:
        for k, (section, end) in enumerate(zip(item.sections, item.section_ends, strict=True)):
            s = np.linspace(section.s, end - 1e-6, 11)
            for one in section.lanes:
                t = item.border(section, one, s, outer=True)
                found[item.id, k, one.id] = item.place(s, t)
    return found


@pytest.mark.parametrize("version", ["1.8", "1.4"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_what_we_write_comes_back(town, tmp_path, side, version):
    model = town(side)
    write_opendrive(model, HERE, tmp_path / "a.xodr", version=version, name="town")
    back, projection, notes = read_opendrive(tmp_path / "a.xodr")
    assert projection == HERE.proj
    assert (notes["version"], notes["remarks"]) == (version, [])
    if (side, version) != ("left", "1.4"):  # which has the form of right-hand traffic
        assert back.driving_side == side
        mine, theirs = borders(model), borders(back)
        assert mine.keys() == theirs.keys()
        assert max(np.abs(mine[key] - theirs[key]).max() for key in mine) < 0.001
        for road_, other in zip(model.roads, back.roads, strict=True):
            assert (road_.id, road_.name, road_.kind, road_.ways, road_.junction) == (
                other.id,
                other.name,
                other.kind,
                other.ways,
                other.junction,
            )
            assert (road_.predecessor, road_.successor) == (other.predecessor, other.successor)
            for section, twin in zip(road_.sections, other.sections, strict=True):
                for lane_, copy in zip(section.lanes, twin.lanes, strict=True):
                    ignored = {"width", "strip", *(("allowed",) if version == "1.4" else ())}
                    for name in vars(lane_).keys() - ignored:
                        a, b = getattr(lane_, name), getattr(copy, name)
                        if name in ("predecessor", "successor") and road_.junction < 0:
                            assert b in (a, None)
                        elif isinstance(a, float):
                            assert b == pytest.approx(a, abs=1e-3)
                        else:
                            assert a == b, (name, lane_.id)
        assert model.junctions[0].connections == back.junctions[0].connections
    write_opendrive(back, HERE, tmp_path / "b.xodr", version=version, name="town")
    again = read_opendrive(tmp_path / "b.xodr").model
    first, second = borders(back), borders(again)
    assert max(np.abs(first[key] - second[key]).max() for key in first) < 0.001
    by_id = {signal.id: signal for signal in back.signals}
    for signal in model.signals:
        copy = by_id[signal.id]
        # In 1.4, CARLA wants its own numbers of signs.
        exact = ("country", "type", "subtype") if version == "1.8" else ()
        for name in ("name", "dynamic", "unit", "links", "program", *exact):
            assert getattr(copy, name) == getattr(signal, name)
        mine, theirs = pose_of(model, signal), pose_of(back, copy)
        assert theirs[:3] == pytest.approx(mine[:3], abs=1e-4)
        assert math.cos(theirs[3] - mine[3]) == pytest.approx(1.0)
        assert copy.value == pytest.approx(signal.value, nan_ok=True)
    assert back.controllers == model.controllers
    assert sorted((a.kind, a.height) for a in back.areas) == sorted(
        (a.kind, a.height) for a in model.areas
    )
    if (side, version) == ("right", "1.8"):
        for area, copy in zip(model.areas, sorted(back.areas, key=lambda a: a.id), strict=True):
            assert (copy.road, copy.s) == (area.road, pytest.approx(area.s))
            assert copy.corners == pytest.approx(area.corners, abs=1e-6)


def test_lane_borders_become_widths(read):
    inner = '<border sOffset="0" a="-3" b="0" c="0" d="0"/>'
    outer = (
        '<border sOffset="0" a="-3" b="-0.02" c="0" d="0"/>'
        '<border sOffset="50" a="-4" b="-0.04" c="0" d="0"/>'
    )
    lanes = (
        f'<laneSection s="0">{CENTRE}<right>{lane(-1, inner=inner)}'
        f"{lane(-2, inner=outer)}</right></laneSection>"
    )
    model = read(road(lanes=lanes)).model
    section = model.roads[0].sections[0]
    assert section.by_id[-1].width.at([0, 60]) == pytest.approx([3, 3])
    assert section.by_id[-2].width.at([0, 25, 49.9, 50, 100]) == pytest.approx(
        [0, 0.5, 0.998, 1, 3]
    )


def test_crossfalls_and_shapes_become_crown_and_bank(read):
    fall = '<crossfall side="{}" s="0" a="{}" b="0" c="0" d="0"/>'
    both = read(road(lateral=fall.format("both", 0.03))).model.roads[0]
    assert (both.crown.at(50), both.bank.at(50)) == (pytest.approx(0.03), pytest.approx(0.0))
    slanted = fall.format("left", 0.04) + fall.format("right", -0.02)
    model = read(road(lateral=slanted)).model.roads[0]
    for t in (-4.0, 3.0):  # down to the left, up to the right
        expected = -0.04 * t if t > 0 else 0.02 * -t
        assert model.place(50.0, t)[0, 2] == pytest.approx(expected, abs=2e-3)
    row = '<shape s="{}" t="{}" a="{}" b="{}" c="0" d="0"/>'
    shapes = row.format(0, -8, -0.16, 0.02) + row.format(0, 0, 0, -0.02)
    shapes += row.format(100, -8, -0.32, 0.04) + row.format(100, 0, 0, -0.04)
    crowned = read(road(lateral=shapes)).model.roads[0]
    assert crowned.crown.at([0, 50, 100]) == pytest.approx([0.02, 0.03, 0.04], abs=1e-9)


def test_types_of_lanes_of_all_versions_have_a_kind(read):
    kinds = {
        "driving": "driving",
        "stop": "shoulder",
        "shoulder": "shoulder",
        "biking": "bicycle",
        "sidewalk": "sidewalk",
        "walking": "sidewalk",
        "border": "shoulder",
        "median": "median",
        "restricted": "shoulder",
        "parking": "parking",
        "entry": "driving",
        "exit": "driving",
        "onRamp": "driving",
        "offRamp": "driving",
        "connectingRamp": "driving",
        "bus": "bus",
        "mwyEntry": "driving",
        "mwyExit": "driving",
        "bidirectional": "driving",
        "curb": "curb",
        "slipLane": "driving",
        "HOV": "driving",
        "taxi": "driving",
        "shared": "driving",
        "tram": "none",
        "rail": "none",
        "special1": "none",
        "none": "none",
        "martian": "none",
    }
    lanes = "".join(lane(-k, kind) for k, kind in enumerate(kinds, start=1))
    text = f'<laneSection s="0">{CENTRE}<right>{lanes}</right></laneSection>'
    model, _, notes = read(road(lanes=text))
    section = model.roads[0].sections[0]
    assert [section.by_id[-k].kind for k in range(1, len(kinds) + 1)] == list(kinds.values())
    told = " ".join(notes["remarks"])
    assert "trams" in told
    assert "'martian'" in told


def test_speeds_have_units_and_fall_back_on_the_road(read):
    def speed(text, **parts):
        lanes = f'<laneSection s="0">{CENTRE}<right>{lane(-1, inner=text)}</right></laneSection>'
        return read(road(lanes=lanes, **parts)).model.roads[0].sections[0].by_id[-1].speed_limit

    town_ = '<type s="0" type="town"><speed max="30" unit="mph"/></type>'
    assert speed('<speed sOffset="0" max="50" unit="km/h"/>') == pytest.approx(50 / 3.6)
    assert speed('<speed sOffset="0" max="25" unit="mph"/>') == pytest.approx(11.176)
    assert speed('<speed sOffset="0" max="12"/>') == pytest.approx(12)
    assert speed("", type=town_) == pytest.approx(13.4112)
    assert speed('<speed sOffset="0" max="no limit"/>', type=town_) == pytest.approx(13.4112)
    assert speed("") == pytest.approx(50 / 3.6)


def test_access_tells_who_may_use_a_lane(read):
    def users(text, kind="driving"):
        lanes = (
            f'<laneSection s="0">{CENTRE}<right>{lane(-1, kind, inner=text)}</right></laneSection>'
        )
        one = read(road(lanes=lanes)).model.roads[0].sections[0].by_id[-1]
        return one.kind, one.allowed

    allow = '<access sOffset="0" rule="allow"><restriction type="bus"/></access>'
    assert users(allow) == ("bus", ("bus",))
    deny = '<access sOffset="0" rule="deny" restriction="trucks"/>'
    assert users(deny) == ("driving", ("car", "bus", "motorcycle", "bicycle"))
    assert users("")[1] == ("car", "truck", "bus", "motorcycle", "bicycle")
    assert users('<access sOffset="0" rule="allow" restriction="bicycle"/>')[0] == "bicycle"


def test_left_hand_rule_and_reversed_lanes(read):
    lanes = (
        f'<laneSection s="0"><left>{lane(1)}</left>{CENTRE}<right>'
        + lane(-1).replace('level="false"', 'direction="reversed"')
        + "</right></laneSection>"
    )
    model = read(road(lanes=lanes, values='junction="-1" rule="LHT"')).model
    assert model.driving_side == "left"
    section = model.roads[0].sections[0]
    assert (section.by_id[1].forward, section.by_id[-1].forward) == (True, True)


@pytest.mark.parametrize(
    "outline",
    [
        '<cornerLocal u="-2" v="-4" z="0.1"/><cornerLocal u="2" v="-4" z="0.1"/>'
        '<cornerLocal u="2" v="4" z="0.1"/><cornerLocal u="-2" v="4" z="0.1"/>',
        '<cornerRoad s="48" t="-4" dz="0.1"/><cornerRoad s="52" t="-4" dz="0.1"/>'
        '<cornerRoad s="52" t="4" dz="0.1"/><cornerRoad s="48" t="4" dz="0.1"/>',
        "",
    ],
    ids=["local", "road", "size"],
)
@pytest.mark.parametrize("kind", ["lines", "flowers"])
def test_crosswalks_of_other_tools(read, outline, kind):
    box = f"<outlines><outline>{outline}</outline></outlines>" if outline else ""
    up = "0" if outline else "0.1"
    tail = (
        '<objects><object type="crosswalk" id="a" s="50" t="0" hdg="0" '
        f'length="4" width="8" zOffset="{up}">{box}'
        f'<userData code="marking" value="{kind}"/></object>'
        '<object type="tree" id="b" s="9" t="9"/></objects>'
    )
    model, _, notes = read(road(tail=tail))
    (area,) = model.areas
    assert (area.kind, area.s) == ("crosswalk", 50)
    assert area.marking == ("lines" if kind == "lines" else "")
    assert any("'flowers'" in text for text in notes["remarks"]) == (kind == "flowers")
    assert area.corners == pytest.approx(
        np.array([[-2, -4, 0.1], [2, -4, 0.1], [2, 4, 0.1], [-2, 4, 0.1]])
    )
    assert any("'tree'" in text for text in notes["remarks"])


def test_a_namespace_and_ids_that_are_words(read):
    root = '<OpenDRIVE xmlns="http://code.asam.net/simulation/standard/opendrive_schema">'
    link = '<link><successor elementType="road" elementId="{B}" contactPoint="start"/></link>'
    second = '<geometry s="0" x="100" y="0" hdg="0" length="100"><line/></geometry>'
    model = read(road("{A}", link=link), road("{B}", geometry=second), root=root).model
    first, other = model.roads
    assert (first.successor.element, first.successor.id) == ("road", other.id)


def test_direct_and_virtual_junctions_are_reported(read, tmp_path, ruler):
    junctions = (
        '<junction id="7" type="direct"><connection id="0" incomingRoad="1" linkedRoad="2" '
        'contactPoint="start"><laneLink from="-1" to="-1"/><laneLink from="1" to="1"/>'
        "</connection></junction>"
        '<junction id="8" type="virtual" mainRoad="2" sStart="10" sEnd="20"/>'
    )
    end = '<link><successor elementType="junction" elementId="7"/></link>'
    begin = '<link><predecessor elementType="junction" elementId="7"/></link>'
    second = '<geometry s="0" x="100" y="0" hdg="0" length="100"><line/></geometry>'
    two = (
        f'<laneSection s="0"><left>{lane(1)}</left>{CENTRE}<right>{lane(-1)}</right></laneSection>'
    )
    first = road("1", lanes=two, link=end)
    model, _, notes = read(first, road("2", second, two, link=begin), junctions)
    (junction,) = model.junctions
    found = {(c.incoming, c.connecting, c.contact, c.links) for c in junction.connections}
    assert found == {(1, 2, "start", ((-1, -1),)), (2, 1, "end", ((1, 1),))}
    told = " ".join(notes["remarks"])
    assert "direct junctions" in told
    assert "virtual junctions" in told
    write_opendrive(model, HERE, tmp_path / "direct.xodr", name="x")
    root, _ = ruler(tmp_path / "direct.xodr")
    assert root.find("junction").get("type") == "direct"
    assert {c.get("linkedRoad") for c in root.iter("connection")} == {"1", "2"}
    again = read_opendrive(tmp_path / "direct.xodr").model
    assert again.junctions[0].connections == junction.connections


@pytest.mark.parametrize(
    "projection",
    [
        "+proj=utm +zone=32 +ellps=WGS84 +datum=WGS84 +units=m +no_defs",
        "+proj=tmerc +lat_0=48.69 +lon_0=9.2 +k=1 +x_0=500 +y_0=0 +datum=WGS84 +units=m "
        "+geoidgrids=egm96_15.gtx +vunits=m +no_defs",
        "EPSG:25832",
    ],
)
def test_a_map_is_placed_by_its_georeference(town, tmp_path, projection):
    """Every lane border, moved point by point by PROJ, is where the moved model has it."""
    crs = projection.replace("+geoidgrids=egm96_15.gtx +vunits=m ", "")
    there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    x, y = there.transform(9.181, 48.701)
    text = "".join(
        f'<geometry s="{s}" x="{x + s}" y="{y}" hdg="0" length="500"><line/></geometry>'
        for s in (0, 500)
    )
    header = (
        f'<header revMajor="1" revMinor="7"><geoReference><![CDATA[{projection}]]></geoReference>'
        "</header>"
    )
    path = tmp_path / "m.xodr"
    path.write_text(whole(road(geometry=text, length=1000), header=header), encoding="utf-8")
    model, told, _ = read_opendrive(path)
    moved = placed(model, told, HERE)
    s = np.linspace(0, 1000, 41)
    line = model.roads[0].place(s, -3.5)[:, :2]
    back = Transformer.from_crs(crs, HERE.proj, always_xy=True)
    expected = np.column_stack(back.transform(line[:, 0], line[:, 1]))
    length = moved.roads[0].length
    found = moved.roads[0]
    lane_ = found.sections[0].by_id[-1]
    at = s * length / 1000
    t = found.border(found.sections[0], lane_, at, outer=True)
    assert np.abs(found.place(at, t)[:, :2] - expected).max() < 0.01
    assert np.abs(expected).max() < 1500


def test_an_offset_of_the_header_is_applied(tmp_path):
    header = (
        '<header revMajor="1" revMinor="7"><geoReference>'
        f'{HERE.proj}</geoReference><offset x="100" y="-50" z="3" hdg="0.5"/></header>'
    )
    path = tmp_path / "m.xodr"
    path.write_text(whole(road(), header=header), encoding="utf-8")
    model = read_opendrive(path).model
    place = model.roads[0].place(10.0, 0.0)[0]
    assert place == pytest.approx([100 + 10 * math.cos(0.5), -50 + 10 * math.sin(0.5), 3])


def test_maps_of_carla_and_roadrunner(read):
    """An origin for a georeference, sections of 0.1 mm, and directions beside the standard's."""

    def vector(number, travel, link=""):
        note = f'<userData><vectorLane travelDir="{travel}"/></userData>'
        width = '<width sOffset="0" a="4" b="0" c="0" d="0"/>'
        return f'<lane id="{number}" type="driving" level="false">{link}{width}{note}</lane>'

    def section(s, *lanes):
        return f'<laneSection s="{s}">{CENTRE}<right>{"".join(lanes)}</right></laneSection>'

    def link(tag, number):
        return f'<link><{tag} id="{number}"/></link>'

    both = '<link><predecessor id="-2"/><successor id="-1"/></link>'
    lanes = (
        section(0, vector(-1, "forward"), vector(-2, "backward", link("successor", -1)))
        + section(50, vector(-1, "backward", both))
        + section(50.0001, vector(-1, "backward", link("predecessor", -1)))
    )
    header = (
        '<header revMajor="1" revMinor="4" vendor="VectorZero">'
        "<geoReference><![CDATA[+lat_0=4.9e+1 +lon_0=8.0e+0]]></geoReference>"
        '<userData><vectorScene program="RoadRunner"/></userData>'
        "</header>"
    )
    model, projection, notes = read(road(lanes=lanes), header=header)
    moved = placed(model, projection, SiteFrame(49.0, 8.0))
    assert moved.roads[0].place(10.0, 0.0)[0] == pytest.approx([10, 0, 0], abs=1e-6)
    assert notes["made_by"] == "VectorZero"
    first, second = model.roads[0].sections
    assert [len(part.lanes) for part in (first, second)] == [2, 1]
    assert (first.by_id[-2].successor, second.by_id[-1].predecessor) == (-1, -2)
    assert [first.by_id[-1].forward, second.by_id[-1].forward] == [True, False]


def test_both_directions_linked_from_one_side(read):
    """Two-way roads through a junction: each lane is linked where it leads in."""
    two = f'<laneSection s="0"><left>{{}}</left>{CENTRE}<right>{{}}</right></laneSection>'
    tied = '<link><predecessor id="{0}"/><successor id="{0}"/></link>'
    plain = two.format(lane(1), lane(-1))
    through = two.format(
        lane(1).replace("<width", tied.format(1) + "<width"),
        lane(-1).replace("<width", tied.format(-1) + "<width"),
    )

    def at(x):
        return f'<geometry s="0" x="{x}" y="0" hdg="0" length="100"><line/></geometry>'

    def link(tag, kind, number, contact=""):
        return f'<{tag} elementType="{kind}" elementId="{number}" {contact}/>'

    ends = link("predecessor", "road", 1, 'contactPoint="end"')
    ends += link("successor", "road", 2, 'contactPoint="start"')
    model = read(
        road("1", lanes=plain, link=f"<link>{link('successor', 'junction', 5)}</link>"),
        road("2", at(200), plain, link=f"<link>{link('predecessor', 'junction', 5)}</link>"),
        road("9", at(100), through, values='junction="5"', link=f"<link>{ends}</link>"),
        '<junction id="5"><connection id="0" incomingRoad="1" connectingRoad="9" '
        'contactPoint="start"><laneLink from="-1" to="-1"/><laneLink from="1" to="1"/>'
        "</connection></junction>",
    ).model
    found = {(c.incoming, c.connecting, c.contact, c.links) for c in model.junctions[0].connections}
    assert found == {(1, 9, "start", ((-1, -1),)), (2, 9, "end", ((1, 1),))}


MISSING = {
    "links of lanes": ".//lane/link",
    "links of roads through junctions": "road[@junction='90']/link",
    "links of streets": "road[@junction='-1']/link",
    "links of lanes in junctions": ".//laneLink",
}


@pytest.mark.parametrize("what", MISSING)
@pytest.mark.parametrize("side", ["right", "left"])
def test_links_that_are_missing_are_found_where_roads_meet(town, tmp_path, side, what):
    """And told of, with the roads."""
    write_opendrive(town(side), HERE, tmp_path / "a.xodr", name="town")
    expected = read_opendrive(tmp_path / "a.xodr").model
    tree = ElementTree.parse(tmp_path / "a.xodr")
    parents = {child: parent for parent in tree.iter() for child in parent}
    gone = tree.findall(MISSING[what])
    assert gone
    for item in gone:
        parents[item].remove(item)
    tree.write(tmp_path / "b.xodr")
    model, _, notes = read_opendrive(tmp_path / "b.xodr")
    assert re.search(r"(link|meet).* \((road|junction) \d+", " ".join(notes["remarks"]))

    def driven(whole):
        for road_ in whole.roads:
            for k, section in enumerate(road_.sections):
                for one in section.lanes:
                    if one.kind in ("driving", "bus", "bicycle"):
                        yield road_.id, k, one.id, one.predecessor, one.successor

    assert list(driven(model)) == list(driven(expected))
    assert model.junctions[0].connections == expected.junctions[0].connections
    for road_, other in zip(model.roads, expected.roads, strict=True):
        assert (road_.predecessor, road_.successor) == (other.predecessor, other.successor)


def test_a_way_through_a_junction_that_leads_nowhere(town, tmp_path):
    write_opendrive(town(), HERE, tmp_path / "a.xodr", name="town")
    tree = ElementTree.parse(tmp_path / "a.xodr")
    way = tree.find("road[@id='12']")
    way.find("link").remove(way.find("link/successor"))
    for piece in way.iter("geometry"):
        piece.set("x", str(float(piece.get("x")) + 30))
    tree.write(tmp_path / "b.xodr")
    model, _, notes = read_opendrive(tmp_path / "b.xodr")
    assert notes["dropped"][0] == "road 12: leads through a junction, but has no successor"
    assert 12 not in model.road_by_id
    named = {(e.incoming, e.connecting) for j in model.junctions for e in j.connections}
    assert named
    assert not any(12 in pair for pair in named)
    assert not any(signal.road == 12 for signal in model.signals)
    check_model(model, tmp_path)


def linked_lane(number, predecessor=None, successor=None, kind="driving"):
    links = "".join(
        f'<{tag} id="{other}"/>'
        for tag, other in (("predecessor", predecessor), ("successor", successor))
        if other is not None
    )
    return lane(number, kind).replace("<width", f"<link>{links}</link><width", 1)


def section_of(s, right, left=""):
    sides = f"<left>{left}</left>" if left else ""
    return f'<laneSection s="{s}">{sides}{CENTRE}<right>{right}</right></laneSection>'


FIRST = section_of(0, linked_lane(-1, successor=-1))
LAST = section_of(40, linked_lane(-1, predecessor=-1))


@pytest.mark.parametrize(
    "between",
    [
        section_of(40, linked_lane(-1, -1, -1)),
        section_of(40, linked_lane(-1, -1, -1)) * 3,
        section_of(40, linked_lane(-1)),
        '<laneSection s="40"/>',
        section_of(40, lane(-1, inner='<width sOffset="0" a="-3" b="0" c="0" d="0"/>')),
        section_of("nan", linked_lane(-1, -1, -1)),
        section_of("", linked_lane(-1, -1, -1)),
        section_of(40.0000001, linked_lane(-1, -1, -1)),
    ],
)
@pytest.mark.parametrize("after", [True, False])
def test_of_lane_sections_at_one_station_one_is_used(read, between, after):
    """The others are dropped, each with its road and station, and lanes go on across them."""
    lanes = FIRST + (LAST + between if after else between + LAST)
    model, _, notes = read(road(lanes=lanes))
    first, second = model.roads[0].sections
    assert (first.s, second.s) == (0.0, pytest.approx(40.0, abs=1e-6))
    assert [one.id for one in second.lanes] == [-1]
    assert first.by_id[-1].successor == -1
    assert second.by_id[-1].predecessor == -1
    assert len(notes["dropped"]) == len(set(notes["dropped"])) >= 1
    assert all(line.startswith("road 1") for line in notes["dropped"])


def test_lane_sections_at_the_start_and_at_the_end_of_a_road_of_no_length(read):
    lanes = "".join(section_of(s, linked_lane(-1, -1, -1)) for s in (0, 0, 60, 100, 100))
    model, _, notes = read(road(lanes=lanes))
    first, second = model.roads[0].sections
    assert (first.s, second.s) == (0.0, 60.0)
    assert first.by_id[-1].successor == second.by_id[-1].predecessor == -1
    assert len(notes["dropped"]) == 2


@pytest.mark.parametrize(
    ("wrong", "kinds"),
    [
        ({-2: 2}, ("driving", "shoulder")),
        ({-1: 1}, ("driving", "shoulder")),
        ({-1: 9, -2: 2}, ("driving", "driving")),
        ({-1: "x"}, ("driving", "driving")),
        ({-2: "1e3"}, ("driving", "driving")),
    ],
)
def test_a_wrong_link_of_a_lane_is_dropped_alone(read, wrong, kinds):
    """The rest of the map is as without the fault; driven lanes go on where they meet."""

    def lanes(wrong):
        after = [linked_lane(k, wrong.get(k, k), None, kinds[-k - 1]) for k in (-1, -2)]
        before = [linked_lane(k, None, k, kinds[-k - 1]) for k in (-1, -2)]
        oncoming = linked_lane(1, None, 1), linked_lane(1, 1)
        return section_of(0, "".join(before), oncoming[0]) + section_of(
            50, "".join(after), oncoming[1]
        )

    right = read(road(lanes=lanes({}))).model
    model, _, notes = read(road(lanes=lanes(wrong)))
    assert len(notes["dropped"]) == len(wrong)
    for number, line in zip(wrong, notes["dropped"], strict=True):
        assert line.startswith(f"road 1, lane section at s = 50, lane {number}: ")
    ours, theirs = model.roads[0].sections[1], right.roads[0].sections[1]
    for number, kind in zip((-1, -2), kinds, strict=True):
        if kind == "driving":
            assert ours.by_id[number].predecessor == theirs.by_id[number].predecessor
    assert ours.by_id[1].predecessor == 1


def test_a_road_whose_links_are_all_wrong_is_still_there(read):
    bad = section_of(0, linked_lane(-1, successor=5)) + section_of(50, linked_lane(-1, 8, 9))
    link = (
        '<link><predecessor elementType="road" elementId="77" contactPoint="end"/>'
        '<successor elementType="junction" elementId="78"/></link>'
    )
    model, _, notes = read(road(lanes=bad, link=link, values='junction="79"'))
    assert len(notes["dropped"]) == 5
    (only,) = model.roads
    assert (only.junction, only.predecessor, only.successor) == (-1, None, None)
    assert only.sections[0].by_id[-1].successor == only.sections[1].by_id[-1].predecessor == -1
