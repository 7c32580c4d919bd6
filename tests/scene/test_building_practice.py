"""Houses that differ: what the map says of them, and what is drawn where it does not."""

from collections import Counter

import numpy as np
import pytest
import shapely
from shapely import box

from urbantwin.drawing.surface_colours import surface_colours
from urbantwin.geometry import PartColours, SiteFrame
from urbantwin.scene.building import building_mesh
from urbantwin.scene.building_outline import MappedBuilding
from urbantwin.scene.building_practice import Neighbours, usual_tags
from urbantwin.scene.tag_values import colour_of
from urbantwin.site import OsmFeature, read_extract
from urbantwin.taxonomy import material_id

from ..thorough import further

REGION = box(-200, -200, 200, 200)
HOUSE = box(0, 0, 10, 8)


def tags_of(number, country, shape=HOUSE, others=(), **tags):
    tags = {key.replace("__", ":"): value for key, value in tags.items()} or {"building": "house"}
    building = MappedBuilding(number, tags, [shape])
    return usual_tags(building, country, 0, Neighbours([shape, *others]))


def build(*shapes_and_tags, country):
    features = [
        OsmFeature("way", k, tags, shape) for k, (shape, tags) in enumerate(shapes_and_tags, 1)
    ]
    return building_mesh(
        features,
        region=REGION,
        ground_height=lambda xy: np.zeros(len(xy)),
        carriageway=shapely.Polygon(),
        country=country,
    )


def test_a_building_looks_the_same_each_time_and_its_neighbour_does_not():
    assert tags_of(7, "DE") == tags_of(7, "DE")
    looks = {tuple(sorted(tags_of(number, "DE").items())) for number in range(40)}
    assert len(looks) > 35


@pytest.mark.parametrize(
    ("country", "key", "value", "share"),
    [
        ("GB", "building:material", "brick", 0.72),
        ("DE", "roof:shape", "gabled", 0.6),
        *further(
            ("US", "building:material", "wood", 0.65),
            ("US", "roof:material", "tar_paper", 0.92 * 0.92),
            ("IN", "roof:shape", "flat", 0.75),
        ),
    ],
)
def test_shares_are_those_of_the_country(country, key, value, share):
    drawn = Counter(tags_of(number, country)[key] for number in range(1000))
    # 4 standard deviations of a share of 1000 draws
    within = 4 * np.sqrt(share * (1 - share) / 1000) + (0.05 if key == "roof:material" else 0)
    assert drawn[value] / 1000 == pytest.approx(share, abs=within)


def test_what_is_mapped_stays():
    mapped = {
        "building": "house", "building__material": "stone", "roof__shape": "pyramidal",
        "roof__colour": "red", "building__colour": "#fff",
    }  # fmt: skip
    for number in range(50):
        assert set(tags_of(number, "GB", **mapped)) == {"roof:material"}


@pytest.mark.parametrize(
    "tags",
    [
        {"building": "house", "height": "14"},
        {"building": "house", "building__levels": "5"},
        {"building": "church"},
        {"building": "house", "roof__height": "2"},
    ],
)
def test_no_roof_is_drawn_where_there_is_none_as_houses_have(tags):
    assert not any("roof:shape" in tags_of(number, "DE", **tags) for number in range(30))
    assert not any("roof:shape" in tags_of(n, "DE", box(0, 0, 40, 30)) for n in range(30))


def test_houses_in_a_row_have_ridges_along_the_row():
    """Five houses, 5 m wide and 9 m deep, wall to wall: all ridges run along x, in the middle."""
    row = [(box(5 * k, 0, 5 * k + 5, 9), {"building": "house"}) for k in range(5)]
    mesh = build(*row, country="NL").mesh
    heights = mesh.vertices[:, 2]
    ridges = mesh.vertices[heights > 6.4 + 0.8]
    assert len(ridges)
    np.testing.assert_allclose(ridges[:, 1], 4.5, atol=0.02)


def test_a_drawn_roof_stands_on_the_storeys_and_keeps_a_mapped_height():
    houses = [(box(20 * k, 0, 20 * k + 10, 8), {"building": "house"}) for k in range(8)]
    for tags, top, eaves in (({}, None, 6.4), ({"height": "7", "building:levels": "2"}, 7.0, 5.0)):
        built = build(*((shape, {**own, **tags}) for shape, own in houses), country="GB")
        mesh = built.mesh
        assert built.notes["roof shape drawn by country"] == 8
        for part in np.unique(mesh.part):
            z = mesh.vertices[np.unique(mesh.faces[mesh.part == part]), 2]
            if top is None:
                assert eaves - 1e-3 <= z.max() <= eaves + 6.0
            else:
                assert z.max() == pytest.approx(top, abs=0.01)
                roof = z[z > eaves - 0.3]
                assert roof.min() >= eaves - 0.3


def test_pictures_show_the_colours_of_the_map():
    tags = {"building": "yes", "building:colour": "#3060a0", "roof:colour": "yellow"}
    mapped = (box(0, 0, 12, 12), {**tags, "building:material": "plaster"})
    built = build(mapped, (box(30, 0, 42, 12), {"building": "yes"}), country="DE")
    shown = surface_colours(built.mesh, built.colours)
    first = built.mesh.part == built.mesh.part.min()
    up = built.mesh.normals()[:, 2] > 0.5
    walls = first & (built.mesh.material == material_id("plaster")) & ~up
    expected = (np.array([0x30, 0x60, 0xA0]) / 255) ** 2.2
    np.testing.assert_allclose(shown[walls], np.tile(expected, (walls.sum(), 1)), atol=1e-6)
    np.testing.assert_allclose(shown[first & up].mean(axis=0), [1, 1, 0], atol=1e-6)
    assert not np.allclose(shown[~first & up].mean(axis=0), [1, 1, 0], atol=0.2)


def test_colours_come_back_from_their_file(tmp_path):
    colours = PartColours.of_rows([(3, 6, False, (1, 2, 3)), (1, 7, True, (4, 5, 6))])
    colours.save(tmp_path / "a.npz")
    again = PartColours.load(tmp_path / "a.npz")
    for name in ("part", "material", "up", "rgb"):
        np.testing.assert_array_equal(getattr(again, name), getattr(colours, name))
    colours.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize(
    ("text", "rgb"),
    [
        ("#a05", (170, 0, 85)),
        ("#AA0055", (170, 0, 85)),
        ("aa0055", (170, 0, 85)),
        ("Light_Grey", (211, 211, 211)),
        ("dark green", (0, 100, 0)),
        ("many", None),
        ("", None),
        (None, None),
    ],
)
def test_colours_as_mappers_write_them(text, rgb):
    assert colour_of(text) == rgb


@pytest.mark.real
@pytest.mark.parametrize(
    ("name", "place", "country"),
    [
        ("taipei", (25.052396, 121.522635), "TW"),
        ("munich", (48.1860, 11.5510), "DE"),
        ("london-borough", (51.5014, -0.0930), "GB"),
    ],
)
def test_real_streets_are_of_many_colours(name, place, country, shared_data):
    region = shapely.Point(0, 0).buffer(120)
    extract = read_extract(shared_data / "osm" / f"{name}.osm")
    built = building_mesh(
        extract.features(SiteFrame(*place), region),
        region=region,
        ground_height=lambda xy: np.zeros(len(xy)),
        carriageway=shapely.Polygon(),
        country=country,
    )
    count = built.notes["buildings"]
    assert count >= 10
    assert len(np.unique(built.colours.rgb, axis=0)) > count
    materials = np.unique(built.mesh.material)
    assert len(materials) >= 5
