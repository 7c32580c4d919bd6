"""OpenDRIVE files that are wrong: one clear line each, with the id of the road, nothing else."""

import re
import time

import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.roads.model.model import check_model
from urbantwin.roads.opendrive import placed, read_opendrive

LINE = '<geometry s="0" x="0" y="0" hdg="0" length="100"><line/></geometry>'
LANE = (
    '<lane id="-1" type="driving" level="false">'
    '<width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
)
CENTRE = '<center><lane id="0" type="none" level="false"/></center>'
SECTION = f'<laneSection s="0">{CENTRE}<right>{LANE}</right></laneSection>'
HEAD = '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="4"/>'


def road(number="12", plan=LINE, lanes=SECTION, values='length="100"', link="", tail=""):
    return (
        f'<road name="" id="{number}" junction="-1" {values}>{link}<planView>{plan}</planView>'
        f"<lanes>{lanes}</lanes>{tail}</road>"
    )


def linked(tag, kind, number, contact='contactPoint="start"'):
    return f'<link><{tag} elementType="{kind}" elementId="{number}" {contact}/></link>'


def geometry(values, shape="<line/>"):
    return f"<geometry {values}>{shape}</geometry>"


def lane(inner, number=-1):
    return (
        f'<laneSection s="0">{CENTRE}<right><lane id="{number}" type="driving">{inner}'
        "</lane></right></laneSection>"
    )


def width(a, b=0, s=0):
    return f'<width sOffset="{s}" a="{a}" b="{b}" c="0" d="0"/>'


END = "</OpenDRIVE>"
JUNCTION = (
    '<junction id="5" name=""><connection id="0" incomingRoad="{}" connectingRoad="{}" '
    'contactPoint="start"><laneLink from="{}" to="-1"/></connection></junction>'
)
PIECE = 's="0" x="0" y="0" hdg="0" length="100"'
SECOND = 's="50" x="{}" y="0" hdg="0" length="50"'

#: A road that nothing is wrong with, far from the others.
SOUND = road("50", plan=LINE.replace('y="0"', 'y="900"'))

#: What is wrong -> (the file, what the line says)
BAD = {
    "not XML": ("this is no XML", "not XML"),
    "empty": ("", "not XML"),
    "another language": ("<osm/>", "not OpenDRIVE: its root is <osm>"),
    "cut off": (HEAD + road()[:150], "not complete XML"),
    "no roads": (HEAD + END, "has no roads"),
    "version 2": ('<OpenDRIVE><header revMajor="2" revMinor="0"/>' + road() + END, "version 2.0"),
    "no reference line": (HEAD + road(plan="") + END, "road 12: has no reference line"),
    "length zero": (HEAD + road(values='length="0"') + END, "road 12: has length 0"),
    "as long as a country": (
        HEAD + road(plan=LINE.replace("100", "1e9"), values='length="1e9"') + END,
        "road 12: has length 1e\\+09",
    ),
    "deeply nested": (HEAD + "<road>" * 5000, "not complete XML"),
    "no length": (HEAD + road(values="") + END, "road 12: <road> length is missing"),
    "negative length": (
        HEAD + road(plan=geometry('s="0" x="0" y="0" hdg="0" length="-5"')) + END,
        "road 12: .* length -5",
    ),
    "nan": (
        HEAD + road(plan=geometry('s="0" x="nan" y="0" hdg="0" length="100"')) + END,
        "road 12, .* x is 'nan'",
    ),
    "inf": (
        HEAD + road(plan=geometry(PIECE, '<arc curvature="1e999"/>')) + END,
        "road 12, .* curvature is '1e999'",
    ),
    "no number": (HEAD + road(lanes=lane(width("wide"))) + END, "road 12, .* a is 'wide'"),
    "no shape": (HEAD + road(plan=geometry(PIECE, "")) + END, "road 12, .* no shape"),
    "a gap": (
        HEAD
        + road(plan=geometry('s="0" x="0" y="0" hdg="0" length="50"') + geometry(SECOND.format(58)))
        + END,
        "road 12: has a gap of 8 m in its reference line at s = 50",
    ),
    "no lanes": (HEAD + road(lanes="") + END, "road 12: has no lanes"),
    "negative width": (
        HEAD + road(lanes=lane(width(-2))) + END,
        "road 12, .*lane -1: is -2 m wide",
    ),
    "width that becomes negative": (
        HEAD + road(lanes=lane(width(3, -0.05))) + END,
        "road 12, .*lane -1: is -2 m wide at s = 100",
    ),
    "width that dips": (
        HEAD + road(lanes=lane('<width sOffset="0" a="2" b="-0.2" c="0.002" d="0"/>')) + END,
        "road 12, .*lane -1: is -3 m wide at s = 50",
    ),
    "lane twice": (
        HEAD
        + road(lanes=f'<laneSection s="0">{CENTRE}<right>{LANE}{LANE}</right></laneSection>')
        + END,
        "road 12, .* has lane -1 twice",
    ),
    "lane on the wrong side": (HEAD + road(lanes=lane(width(3), 1)) + END, "road 12, .* lane 1 on"),
    "section beyond the end": (
        HEAD + road(lanes=SECTION + SECTION.replace('s="0"', 's="150"', 1)) + END,
        "road 12: has a lane section at s = 150, beyond its end",
    ),
    "superelevation in degrees": (
        HEAD
        + road().replace(
            "<lanes>",
            '<lateralProfile><superelevation s="0" a="5" b="0" c="0" d="0"/></lateralProfile>'
            "<lanes>",
        )
        + END,
        "road 12: has a superelevation of more than 1 radian",
    ),
    "road that is not there": (
        HEAD + road(link=linked("successor", "road", 99)) + END,
        "road 12: has the successor road 99, which does not exist",
    ),
    "junction that is not there": (
        HEAD + road(link=linked("predecessor", "junction", 7, "")) + END,
        "road 12: has the predecessor junction 7, which does not exist",
    ),
    "within a junction that is not there": (
        HEAD + road().replace('junction="-1"', 'junction="4"') + END,
        "road 12: leads through junction 4, which does not exist",
    ),
    "itself": (
        HEAD + road(link=linked("successor", "road", 12)) + END,
        "road 12: is its own successor",
    ),
    "road twice": (HEAD + road() + road() + END, "road 12: is there twice"),
    "junction twice": (
        HEAD + road() + '<junction id="5"/>' * 2 + END,
        "junction 5: is there twice",
    ),
    "lane that is not there": (
        HEAD
        + road(
            lanes=lane('<link><successor id="-4"/></link>' + width(3)),
            link=linked("successor", "road", 13),
        )
        + road("13", plan=LINE.replace('x="0"', 'x="100"'))
        + END,
        "road 12, lane section at s = 0, lane -1: has the successor lane -4, which does not exist",
    ),
    "lane of the next section that is not there": (
        HEAD
        + road(
            lanes=lane('<link><successor id="-2"/></link>' + width(3))
            + SECTION.replace('s="0"', 's="40"', 1)
        )
        + END,
        "road 12, lane section at s = 0, lane -1: has the successor lane -2, which does not exist",
    ),
    "junction of roads that are not there": (
        HEAD + road() + JUNCTION.format(12, 77, -1) + END,
        "junction 5, connection 0: has the connectingRoad 77, which does not exist",
    ),
    "junction of a road with itself": (
        HEAD + road() + JUNCTION.format(12, 12, -1) + END,
        "junction 5, connection 0: joins road 12 to itself",
    ),
    "junction of lanes that are not there": (
        HEAD
        + road()
        + road("13").replace('junction="-1"', 'junction="5"')
        + JUNCTION.format(12, 13, -9)
        + END,
        "junction 5, connection 0: links lane -9 of road 12, which does not exist",
    ),
    "signal of a controller that is not there": (
        HEAD + road() + '<controller id="3"><control signalId="8"/></controller>' + END,
        "controller 3: switches signal 8, which does not exist",
    ),
    "speed in knots": (
        HEAD + road(lanes=lane(width(3) + '<speed sOffset="0" max="9" unit="kn"/>')) + END,
        "road 12, .* 'kn'",
    ),
    "rule": (HEAD + road(values='length="100" rule="UK"') + END, "road 12: has the rule 'UK'"),
    "document type": (
        '<!DOCTYPE OpenDRIVE><OpenDRIVE><header revMajor="1" revMinor="4"/>' + road() + END,
        "document type",
    ),
    "external entity": (
        '<?xml version="1.0"?><!DOCTYPE OpenDRIVE [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
        f'<OpenDRIVE><header revMajor="1" revMinor="4" name="&x;"/>{road()}{END}',
        "document type",
    ),
    "entity without a document type": (
        HEAD.replace("<header", "&x;<header") + road() + END,
        "not complete XML",
    ),
    "billion laughs": (
        '<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a0 "lol">'
        + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
        + "]><OpenDRIVE>&a11;</OpenDRIVE>",
        "document type",
    ),
}


#: Of these the map goes on without what is wrong: a road to drive on remains.
DROPPED = (
    *("width that becomes negative", "width that dips", "lane twice", "section beyond the end"),
    *("superelevation in degrees", "road that is not there", "junction that is not there"),
    *("within a junction that is not there", "itself", "road twice", "junction twice"),
    *("lane that is not there", "lane of the next section that is not there"),
    *("junction of roads that are not there", "junction of a road with itself"),
    *("junction of lanes that are not there", "signal of a controller that is not there"),
    *("speed in knots", "rule"),
)
#: Of these nothing can be read, whatever else the file holds.
UNREADABLE = (
    *("not XML", "empty", "another language", "cut off", "no roads", "version 2"),
    *("deeply nested", "document type", "external entity", "entity without a document type"),
    "billion laughs",
)


def has_a_lane_to_drive_on(model):
    return any(
        lane.kind == "driving" and lane.width.at([0.0])[0] > 1.0
        for road in model.roads
        for section in road.sections
        for lane in section.lanes
    )


@pytest.mark.parametrize("name", [name for name in BAD if name not in UNREADABLE])
def test_a_fault_costs_a_map_no_more_than_what_holds_it(tmp_path, name):
    text, expected = BAD[name]
    path = tmp_path / "map.xodr"
    text = text if name in DROPPED else text.replace(END, SOUND + END)
    path.write_text(text, encoding="utf-8")
    model, _, notes = read_opendrive(path)
    assert has_a_lane_to_drive_on(model)
    said = [line for line in notes["dropped"] if re.search(expected, line)]
    assert len(said) == 1, notes["dropped"]
    assert len(set(notes["dropped"])) == len(notes["dropped"])
    check_model(model, path)


@pytest.mark.parametrize("name", [name for name in BAD if name not in DROPPED])
def test_one_line_says_what_is_wrong(tmp_path, name):
    text, expected = BAD[name]
    path = tmp_path / "map.xodr"
    path.write_text(text, encoding="utf-8")
    start = time.perf_counter()
    with pytest.raises(InputError) as error:
        read_opendrive(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ")
    assert re.search(expected, line), line
    assert "\n" not in line
    assert time.perf_counter() - start < 5.0
    assert [file.name for file in tmp_path.iterdir()] == ["map.xodr"]


@pytest.mark.parametrize("length", ["80", "100.2", "2000"])
def test_a_road_is_as_long_as_its_reference_line(tmp_path, length):
    """As in public maps of esmini and Scenic, whose roads say 2000 m for 500 and 20 m for 100."""
    path = tmp_path / "map.xodr"
    path.write_text(HEAD + road(values=f'length="{length}"') + END)
    read = read_opendrive(path)
    assert [one.length for one in read.model.roads] == [pytest.approx(100.0)]
    assert read.notes["dropped"] == []
    assert "roads whose length is not that of their reference line" in read.notes["remarks"][0]


def test_a_spiral_that_does_not_say_where_it_begins_to_bend_starts_straight(tmp_path):
    path = tmp_path / "map.xodr"
    spiral = LINE.replace("<line/>", '<spiral curvEnd="0.01"/>')
    assert spiral != LINE
    path.write_text(HEAD + road(plan=spiral) + END)
    read = read_opendrive(path)
    assert read.model.roads[0].curve.at([100.0])[0, 2] == pytest.approx(0.5, abs=1e-3)
    assert "straight where they do not say" in read.notes["remarks"][0]


def test_a_file_that_is_not_there_and_a_folder(tmp_path):
    for path in (tmp_path / "none.xodr", tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            read_opendrive(path)


def test_a_file_that_is_too_large_is_refused_at_once(tmp_path):
    path = tmp_path / "map.xodr"
    with path.open("wb") as file:
        file.write((HEAD + road()).encode())
        file.truncate(300_000_000)
    start = time.perf_counter()
    with pytest.raises(InputError, match="is 300 MB large; expected 200 MB or less"):
        read_opendrive(path)
    assert time.perf_counter() - start < 1.0


def test_utf_16_hides_no_document_type(tmp_path):
    path = tmp_path / "map.xodr"
    path.write_bytes(
        BAD["external entity"][0].replace('?xml version="1.0"', "xml").encode("utf-16")
    )
    with pytest.raises(InputError):
        read_opendrive(path)
    text = BAD["external entity"][0].partition("?>")[2]
    path.write_bytes(text.encode("utf-16"))
    with pytest.raises(InputError, match="document type"):
        read_opendrive(path)


def test_a_ring_may_go_on_as_itself(tmp_path):
    ring = geometry(
        's="0" x="0" y="0" hdg="0" length="62.83185307179586"', '<arc curvature="0.1"/>'
    )
    path = tmp_path / "map.xodr"
    path.write_text(
        HEAD
        + road(plan=ring, values='length="62.83185307"', link=linked("successor", "road", 12))
        + END
    )
    (only,) = read_opendrive(path).model.roads
    assert (only.successor.id, only.successor.contact) == (12, "start")


def test_small_faults_are_remarked(tmp_path):
    plan = geometry('s="0" x="0" y="0" hdg="0" length="50"') + geometry(SECOND.format(50.2))
    path = tmp_path / "map.xodr"
    path.write_text(HEAD + road(plan=plan, lanes=lane(width(0, -1e-5))) + END)
    remarks = " ".join(read_opendrive(path).notes["remarks"])
    assert "gaps of more than 1 cm (road 12)" in remarks
    assert "narrower than nothing" in remarks


@pytest.mark.parametrize(
    "projection", ["EPSG:4326", "+proj=nonsense", "rubbish", "+proj=utm +zone=99"]
)
def test_a_georeference_that_cannot_be_used(tmp_path, projection):
    path = tmp_path / "map.xodr"
    header = f'<header revMajor="1" revMinor="4"><geoReference>{projection}</geoReference></header>'
    path.write_text(f"<OpenDRIVE>{header}{road()}{END}")
    model, told, _ = read_opendrive(path)
    with pytest.raises(InputError, match="georeference"):
        placed(model, told, SiteFrame(48.7, 9.18))
