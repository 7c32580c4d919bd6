"""CityGML against closed forms, against the same model as CityJSON, and against damage."""

import gzip
import json
import zipfile

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.io.cities.citygml import read_citygml
from urbantwin.io.cities.cityjson import read_cityjson
from urbantwin.io.systems import named_system
from urbantwin.taxonomy import semantic_id

from ..reconstruct.model_files import area, read, volume
from .city_gml import HOUSE_M3, ROOF_M2, block, city, house, polygon, solid

VERSIONS = ("1.0", "2.0", "3.0")


def written(folder, text, name="m.gml"):
    path = folder / name
    path.write_text(text)
    return path


def of(mesh, words):
    """The triangles of objects whose names hold some words."""
    chosen = [k for k, name in enumerate(mesh.names) if words in name]
    return mesh.select(np.isin(mesh.object, chosen))


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("how", ["posList", "pos", "coordinates"])
def test_a_house_whose_solid_refers_to_its_surfaces(tmp_path, version, how):
    text = city(version, house(version, at=(500.0, 700.0, 30.0), how=how))
    mesh = read(written(tmp_path, text)).mesh
    assert volume(mesh) == pytest.approx(HOUSE_M3, rel=1e-9)
    assert area(of(mesh, "RoofSurface")) == pytest.approx(ROOF_M2, rel=1e-9)
    assert area(of(mesh, "GroundSurface")) == pytest.approx(80.0, rel=1e-9)
    assert np.allclose(mesh.vertices.min(axis=0), [500, 700, 30])
    assert (mesh.semantic == semantic_id("building")).all()
    assert set(mesh.names) == {f"Building h1 / {k}Surface" for k in ("Ground", "Wall", "Roof")}


@pytest.mark.parametrize("version", VERSIONS)
def test_the_finest_level_of_each_object(tmp_path, version):
    both = house(version).replace(
        "</bldg:Building>",
        block(version, "x", (0, 0, 0), (10, 8, 7))
        .replace('<bldg:Building gml:id="x">', "")
        .replace("</bldg:Building>", "")
        + "</bldg:Building>",
    )
    text = city(version, both, block(version, "b2", (20, 0, 0), (22, 3, 4)))
    model = read(written(tmp_path, text))
    assert volume(of(model.mesh, "h1")) == pytest.approx(HOUSE_M3)
    assert volume(of(model.mesh, "b2")) == pytest.approx(24.0)
    assert model.notes["levels_of_detail"] == {"1": 1, "2": 1}
    assert model.notes["version"] == version


def test_parts_stand_for_the_building_and_installations_beside_it(tmp_path):
    part = "<bldg:consistsOfBuildingPart><bldg:BuildingPart gml:id='p{}'>{}</bldg:BuildingPart>"
    part += "</bldg:consistsOfBuildingPart>"
    boxes = []
    for k, (low, high) in enumerate([((0, 0, 0), (2, 3, 4)), ((2, 0, 0), (4, 3, 2))]):
        inner = block("2.0", "x", low, high).removeprefix('<bldg:Building gml:id="x">')
        boxes.append(part.format(k, inner.removesuffix("</bldg:Building>")))
    chimney = block("2.0", "x", (0, 0, 4), (1, 1, 5)).removeprefix('<bldg:Building gml:id="x">')
    chimney = chimney.removesuffix("</bldg:Building>").replace("lod1Solid", "lod2Geometry")
    outside = f"<bldg:outerBuildingInstallation><bldg:BuildingInstallation gml:id='c'>{chimney}"
    outside += "</bldg:BuildingInstallation></bldg:outerBuildingInstallation>"
    text = city("2.0", block("2.0", "b", (0, 0, 0), (4, 3, 4), "".join(boxes) + outside))
    mesh = read(written(tmp_path, text)).mesh
    assert volume(of(mesh, "p0")) == pytest.approx(24.0)
    assert volume(of(mesh, "p1")) == pytest.approx(12.0)
    assert volume(of(mesh, "BuildingInstallation c")) == pytest.approx(1.0)
    assert not len(of(mesh, "Building b").faces)


def test_a_window_fills_the_hole_of_its_wall(tmp_path):
    wall = [(0, 0, 0), (10, 0, 0), (10, 0, 6), (0, 0, 6)]
    glass = [(2, 0, 1), (5, 0, 1), (5, 0, 3), (2, 0, 3)]

    def many(text):
        inner = (
            f"<gml:MultiSurface><gml:surfaceMember>{text}</gml:surfaceMember></gml:MultiSurface>"
        )
        return f"<bldg:lod3MultiSurface>{inner}</bldg:lod3MultiSurface>"

    inside = (
        f"<bldg:boundedBy><bldg:WallSurface>{many(polygon(wall, holes=[glass[::-1]]))}"
        f"<bldg:opening><bldg:Window>{many(polygon(glass))}</bldg:Window></bldg:opening>"
        "</bldg:WallSurface></bldg:boundedBy>"
        f"<bldg:boundedBy><bldg:ClosureSurface>{many(polygon(wall, 'virtual'))}"
        "</bldg:ClosureSurface></bldg:boundedBy>"
        f"<bldg:interiorRoom><bldg:Room>{many(polygon(glass, 'inside')).replace('lod3', 'lod4')}"
        "</bldg:Room></bldg:interiorRoom>"
    )
    text = city("2.0", f'<bldg:Building gml:id="b">{inside}</bldg:Building>')
    model = read(written(tmp_path, text))
    assert area(of(model.mesh, "WallSurface")) == pytest.approx(60 - 6)
    assert area(of(model.mesh, "Window")) == pytest.approx(6)
    assert area(model.mesh) == pytest.approx(60)
    assert model.notes["virtual_surfaces_left_out"] == 1


def test_surfaces_that_neighbours_share_close_both(tmp_path):
    """A party wall is one polygon; the other house has it by reference, turned round."""
    first = block("2.0", "b1", (0, 0, 0), (2, 3, 4))
    shared = polygon([(2, 0, 0), (2, 3, 0), (2, 3, 4), (2, 0, 4)])
    assert first.count(shared) == 1
    first = first.replace(shared, shared.replace("<gml:Polygon", '<gml:Polygon gml:id="party"'))
    second = block("2.0", "b2", (2, 0, 0), (4, 3, 4))
    own = polygon([(2, 3, 0), (2, 0, 0), (2, 0, 4), (2, 3, 4)])
    assert second.count(own) == 1
    turned = (
        '<gml:OrientableSurface orientation="-"><gml:baseSurface>{}</gml:baseSurface>'
        "</gml:OrientableSurface>"
    )
    turned_inline = turned.format(polygon([(2, 0, 0), (2, 3, 0), (2, 3, 4), (2, 0, 4)]))
    mesh = read(written(tmp_path, city("2.0", first, second.replace(own, turned_inline)))).mesh
    assert [volume(of(mesh, name)) for name in ("b1", "b2")] == pytest.approx([24.0, 24.0])
    refers = second.replace(
        f"<gml:surfaceMember>{own}</gml:surfaceMember>", '<gml:surfaceMember xlink:href="#party"/>'
    )
    for order in ((first, refers), (refers, first)):  # also to what comes later
        mesh = read(written(tmp_path, city("2.0", *order))).mesh
        assert area(of(mesh, "b2")) == pytest.approx(2 * (2 * 3 + 3 * 4 + 2 * 4))
    model = read(written(tmp_path, city("2.0", refers)))
    assert "1 references lead to surfaces that are not in the file" in model.problems


def test_other_objects_have_their_classes_and_templates_their_places(tmp_path):
    tree = solid([polygon([(0, 0, 0), (1, 0, 0), (0, 1, 0)])])
    turned = "0 -2 0 0 2 0 0 0 0 0 2 0 0 0 0 1"
    implicit = (
        '<veg:SolitaryVegetationObject gml:id="t"><veg:lod2ImplicitRepresentation>'
        f"<core:ImplicitGeometry><core:transformationMatrix>{turned}</core:transformationMatrix>"
        f"<core:relativeGMLGeometry>{tree}</core:relativeGMLGeometry><core:referencePoint>"
        "<gml:Point><gml:pos>50 60 7</gml:pos></gml:Point></core:referencePoint>"
        "</core:ImplicitGeometry></veg:lod2ImplicitRepresentation></veg:SolitaryVegetationObject>"
    )
    flat = polygon([(0, 0, 0), (9, 0, 0), (9, 4, 0), (0, 4, 0)])
    lane = f"<gml:MultiSurface><gml:surfaceMember>{flat}</gml:surfaceMember></gml:MultiSurface>"
    road = (
        '<tran:Road gml:id="r"><tran:trafficArea><tran:TrafficArea><tran:lod2MultiSurface>'
        f"{lane}</tran:lod2MultiSurface></tran:TrafficArea></tran:trafficArea></tran:Road>"
    )
    text = city("2.0", implicit, road, "<gen:Strange/>")
    model = read(written(tmp_path, text))
    found = of(model.mesh, "SolitaryVegetationObject t")
    corners = {tuple(p) for p in found.vertices[found.faces].reshape(-1, 3).round(6).tolist()}
    assert corners == {(50, 60, 7), (50, 62, 7), (48, 60, 7)}
    assert set(found.semantic) == {semantic_id("vegetation")}
    assert set(of(model.mesh, "Road r / TrafficArea").semantic) == {semantic_id("road")}
    assert any("1 x Strange" in text for text in model.problems)


@pytest.mark.parametrize(
    ("name", "code", "vertical"),
    [
        ("EPSG:28992", 28992, None),
        ("urn:ogc:def:crs:EPSG::7415", 28992, "NAP"),
        ("urn:ogc:def:crs,crs:EPSG::25832,crs:EPSG::5783", 25832, "DHHN92"),
        ("urn:ogc:def:crs,crs:EPSG:6.12:3068,crs:EPSG:6.12:5783", 3068, "DHHN92"),
        ("http://www.opengis.net/def/crs/EPSG/0/25833", 25833, None),
        ("http://www.opengis.net/gml/srs/epsg.xml#25832", 25832, None),
        ("urn:adv:crs:ETRS89_UTM32*DE_DHHN2016_NH", 25832, "DHHN2016"),
        ("urn:adv:crs:ETRS89_UTM33", 25833, None),
    ],
)
def test_names_of_systems(name, code, vertical):
    crs = named_system(name)
    plan = crs.sub_crs_list[0] if crs.is_compound else crs
    assert plan.to_epsg() == code
    assert crs.is_compound == (vertical is not None)
    if vertical:
        assert vertical in crs.sub_crs_list[1].name


def test_a_model_in_degrees_latitude_first(tmp_path):
    """As Japan's PLATEAU has it: EPSG:6697, by its definition latitude, longitude, height."""
    frame = SiteFrame(35.68, 139.76)
    corners = frame.lonlat_from_site(np.array([[0, 0], [10, 8.0]]))
    (west, south), (east, north) = corners.tolist()
    text = city(
        "2.0",
        block("2.0", "b", (south, west, 3.0), (north, east, 9.0)),
        srs="http://www.opengis.net/def/crs/EPSG/0/6697",
    )
    model = read(written(tmp_path, text), frame=frame)
    assert model.notes["north_before_east"]
    assert model.crs.is_geographic or model.crs.sub_crs_list[0].is_geographic
    xy = frame.site_from_lonlat(model.mesh.vertices[:, :2])
    assert np.abs(xy).max() < 11
    # Turned inside out: the test's box runs round as x, y, and these are y, x.
    metric = np.column_stack([xy, model.mesh.vertices[:, 2]])
    placed = type(model.mesh)(
        metric, model.mesh.faces, None, model.mesh.object, model.mesh.names, model.mesh.semantic
    )
    assert abs(volume(placed)) == pytest.approx(480.0, rel=1e-3)


@pytest.mark.parametrize("srs", ["urn:ogc:def:crs:EPSG::31467", "EPSG:31467"])
@pytest.mark.parametrize("north_first", [True, False])
def test_the_order_of_axes_is_that_in_which_the_model_lies_where_its_system_holds(
    tmp_path, srs, north_first
):
    """Gauss-Krueger names north first; many files do not. 3.5 M is an easting, 5.4 M a northing."""
    east, north = 3_513_000.0, 5_400_000.0
    first, second = (north, east) if north_first else (east, north)
    text = city("2.0", block("2.0", "b", (first, second, 0), (first + 2, second + 3, 4)), srs=srs)
    model = read(written(tmp_path, text))
    assert model.notes["north_before_east"] == north_first
    assert np.allclose(model.mesh.vertices.min(axis=0), [east, north, 0])


def test_packed_files(tmp_path):
    text = city("2.0", house("2.0"))
    (tmp_path / "m.gml.gz").write_bytes(gzip.compress(text.encode()))
    with zipfile.ZipFile(tmp_path / "m.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("folder/m.gml", text)
        archive.writestr("codelists/x.txt", "none")
    for name in ("m.gml.gz", "m.zip"):
        assert volume(read(tmp_path / name).mesh) == pytest.approx(HOUSE_M3)
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.writestr("a.gml", text)
        archive.writestr("b.gml", text)
    with pytest.raises(InputError, match="archive"):
        read(tmp_path / "two.zip")


def refusal(path):
    """What is said of a file that is refused; ``None`` if it is read."""
    try:
        assert read(path).mesh is not None
    except InputError as error:
        return str(error)
    return None


BOMB = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>'
OUTSIDE = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda t: t.replace("<core:CityModel", BOMB + "<core:CityModel"), "document type"),
        (lambda t: t.replace("<core:CityModel", OUTSIDE + "<core:CityModel"), "document type"),
        (lambda t: t[: len(t) // 2], "not complete XML"),
        (lambda t: t.replace("CityModel", "Town"), "root is <Town>"),
        (lambda t: "", "is empty"),
        (lambda t: "hello", "is not XML"),
        (lambda t: city("2.0"), "holds no surface"),
        (lambda t: t.replace("0.0 0.0 6.0", "0.0 x 6.0").replace("lod2", "lod2"), None),
        (lambda t: t.replace('srsDimension="3"', 'srsDimension="2"'), "holds no surface"),
        (lambda t: t.replace("600.0", "nan"), None),
    ],
)
def test_damage_is_one_line_or_a_problem_told(tmp_path, change, says):
    path = written(tmp_path, change(city("2.0", house("2.0"), srs="EPSG:28992")))
    said = refusal(path)
    assert (said is None) == (says is None)
    if says is not None:
        assert says in said
        assert "\n" not in said


def test_a_bomb_of_zeros_is_refused_before_it_fills_memory(tmp_path, monkeypatch):
    monkeypatch.setattr("urbantwin.io.cities.citygml.LARGEST", 1_000_000)
    text = city("2.0", house("2.0")).replace("<core:cityO", " " * 5_000_000 + "<core:cityO", 1)
    (tmp_path / "m.gml.gz").write_bytes(gzip.compress(text.encode()))
    with pytest.raises(InputError, match="holds more than"):
        read(tmp_path / "m.gml.gz")


@given(st.text(alphabet="<>/=\"' abcgml:Polygon0123456789.\n", max_size=200), st.integers(0, 2000))
def test_any_text_within_is_told_in_one_line(tmp_path_factory, text, place):
    whole = city("2.0", house("2.0"))
    path = written(tmp_path_factory.getbasetemp(), whole[:place] + text + whole[place:], "any.gml")
    assert "\n" not in (refusal(path) or "")


def as_citygml(document):
    """The solids of a CityJSON document as CityGML, surface by surface."""
    vertices = np.array(document["vertices"])
    objects = []
    for name, one in document["CityObjects"].items():
        if one["type"] != "Building":
            continue
        shells = [g["boundaries"] for g in one["geometry"] if g["type"] == "Solid"]
        for shell in (surface for solids in shells for surface in solids):
            members = [
                polygon(vertices[face[0]].tolist(), holes=[vertices[h].tolist() for h in face[1:]])
                for face in shell
            ]
            objects.append(
                f'<bldg:Building gml:id="{name}"><bldg:lod1Solid>{solid(members)}'
                "</bldg:lod1Solid></bldg:Building>"
            )
    return city("2.0", *objects, srs="urn:ogc:def:crs:EPSG::7415")


@pytest.mark.thorough
def test_the_reference_model_of_delft_is_the_same_as_in_cityjson(tmp_path, shared_data):
    source = shared_data / "airborne/delft-ahn3/reference/testarea.json"
    document = json.loads(source.read_text())
    model = read_citygml(written(tmp_path, as_citygml(document)))
    other = read_cityjson(source)
    buildings = other.mesh.select(
        np.isin(other.mesh.object, [k for k, n in enumerate(other.mesh.names) if "Building" in n])
    )
    assert area(model.mesh) == pytest.approx(area(buildings), rel=1e-9)
    assert volume(model.mesh) == pytest.approx(volume(buildings), rel=1e-6)
    assert model.crs.is_compound
    for mesh in (model.mesh, buildings):
        assert len(np.unique(mesh.object)) > 100
    outline = [shapely.MultiPoint(m.vertices[:, :2]).convex_hull for m in (model.mesh, buildings)]
    assert outline[0].symmetric_difference(outline[1]).area < 1e-3
