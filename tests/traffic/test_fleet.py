"""The fleet: bodies that differ, sizes by the tables, and each actor by its number alone."""

from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES, material_id
from urbantwin.traffic.assets import (
    AssetName,
    Fleet,
    OwnBodies,
    asset,
    asset_mesh,
    asset_names,
    mesh_among,
)

GERMANY = Fleet("DE", 1)


def tables():
    return yaml.safe_load(files("urbantwin.traffic.assets").joinpath("fleet.yaml").read_text())


def outline(name):
    """Return what an asset covers of the plane y = 0, seen from the side."""
    mesh = asset_mesh(name)
    corners = mesh.triangles()
    # Its surfaces are closed: what faces one side covers as much as all of it.
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 1] > 2e-5
    triangles = shapely.polygons(corners[facing][:, :, [0, 2]])
    return shapely.union_all(triangles, grid_size=1e-3)


@pytest.mark.thorough
def test_the_outlines_of_cars_differ():
    outlines = {name: outline(name) for name in asset_names("car")}
    # To the same length and height, so that it is the shape that differs.
    fit = {}
    for name, shape in outlines.items():
        x0, z0, x1, z1 = shape.bounds
        fit[name] = shapely.transform(
            shape, lambda xz, at=(x0, z0), by=(x1 - x0, z1 - z0): (xz - at) / by
        )
    apart = {}
    for a, b in combinations(sorted(fit), 2):
        shared = (fit[a] & fit[b]).area
        apart[a, b] = 1 - shared / (fit[a].area + fit[b].area - shared)
    # A 50th of the silhouette differs, for 25 bodies at least, one from each other.
    kept = []
    for name in sorted(fit):
        if all(apart[one, name] > 0.02 for one in kept):
            kept.append(name)
    assert len(kept) >= 25


@pytest.mark.parametrize("actor_class", ACTOR_CLASSES)
def test_everybody_is_in_the_catalogue(actor_class):
    for country in ("DE", "US", "JP", ""):
        for number in range(40):
            found = asset(Fleet(country, 3).body(actor_class, number))
            assert found.actor_class == actor_class


@pytest.mark.parametrize("region", [("DE", "europe"), ("US", "north-america"), ("JP", "japan")])
def test_cars_come_in_the_shares_and_sizes_of_the_table(region):
    country, name = region
    kinds = tables()[name]["car"]
    total = sum(kind["share"] for kind in kinds.values())
    expected = dict.fromkeys(("length", "width", "height"), 0.0)
    for kind in kinds.values():
        for side in expected:
            usual = np.mean([getattr(asset(body), side) for body in kind["bodies"]])
            expected[side] += kind["share"] / total * kind.get(side, [usual])[0]
    cars = [asset(Fleet(country, 5).body("car", number)) for number in range(600)]
    for side, mean in expected.items():
        assert np.mean([getattr(car, side) for car in cars]) == pytest.approx(mean, rel=0.005)


def test_an_actor_depends_on_its_number_alone_and_on_the_seed():
    names = [GERMANY.body("car", number) for number in range(100)]
    assert [GERMANY.body("car", number) for number in reversed(range(100))] == names[::-1]
    assert len(set(names)) > 90
    assert [Fleet("DE", 2).body("car", number) for number in range(100)] != names


def test_few_actors_spread_as_many_do():
    many = np.quantile([asset(GERMANY.body("car", k)).length for k in range(2000)], [0.1, 0.5, 0.9])
    few = np.quantile([asset(GERMANY.body("car", k)).length for k in range(60)], [0.1, 0.5, 0.9])
    np.testing.assert_allclose(few, many, rtol=0.04)


def test_the_coats_keep_their_shares():
    white = np.mean(
        [GERMANY.body("car", k).partition("@")[0].endswith("_white") for k in range(380)]
    )
    assert white == pytest.approx(4 / 19, abs=0.02)


def test_a_name_says_body_coat_and_size():
    name = AssetName.of("car-sedan_black@4.90x1.80x1.45")
    assert name == ("car-sedan", "black", (4.90, 1.80, 1.45))
    assert str(name) == "car-sedan_black@4.90x1.80x1.45"
    assert name.unsized == "car-sedan_black"
    assert AssetName.of("pedestrian-man") == ("pedestrian-man", "", None)
    for wrong in ("car-sedan@", "car-nova@4.70x1.85x1.45", "car-sedan_pink@4.70x1.85x1.45"):
        with pytest.raises(InputError, match="unknown asset"):
            asset_mesh(wrong)


def test_a_body_in_another_size_is_stretched_and_its_wheels_stay_round():
    sized = asset_mesh("car-sedan@5.26x1.79x1.30")
    low, high = sized.vertices.min(axis=0), sized.vertices.max(axis=0)
    expected = [5.26, 1.79, 1.30]
    np.testing.assert_allclose(high - low, expected, rtol=1e-6)
    found = asset("car-sedan@5.26x1.79x1.30")
    np.testing.assert_allclose([found.length, found.width, found.height], expected, rtol=1e-6)
    wheels = np.unique(sized.part[(sized.triangles()[..., 2] < 1e-6).any(axis=1)])
    assert len(wheels) == 4
    for part in wheels:
        wheel = sized.select(sized.part == part)
        assert (wheel.material == material_id("rubber")).any()
        extent = np.ptp(wheel.vertices, axis=0)
        assert extent[0] == pytest.approx(extent[2], rel=0.015)
        # They stand where the contacts say.
        middle = wheel.vertices.min(axis=0) + extent / 2
        assert np.abs(found.contacts[:, 0] - middle[0]).min() < 0.01


def test_of_a_sized_actor_its_body_is_kept():
    body = asset_mesh("car-sedan_black")
    kept = {("car-sedan_black", 0): body}

    def refuse(name, phase):
        raise AssertionError(name)

    found = mesh_among(kept, "car-sedan_black@4.90x1.80x1.45", 0, refuse)
    np.testing.assert_array_equal(
        found.vertices, asset_mesh("car-sedan_black@4.90x1.80x1.45").vertices
    )
    assert mesh_among(kept, "car-sedan_black", 0, refuse) is body


def test_bodies_of_a_site_take_their_share_and_have_their_own_size() -> None:
    mesh = asset_mesh("van-cube")
    own = OwnBodies({"own-cube": "van"}, {"own-cube": 0.25}, {("own-cube", 0): mesh})
    fleet = Fleet("DE", 4, own)
    names = [fleet.body("van", number) for number in range(400)]
    assert np.mean([name == "own-cube" for name in names]) == pytest.approx(0.25, abs=0.02)
    assert {fleet.body("car", number) for number in range(50)}.isdisjoint({"own-cube"})
    found = own.asset("own-cube")
    np.testing.assert_allclose(
        [found.length, found.width, found.height], np.ptp(mesh.vertices, axis=0)
    )
    assert found.actor_class == "van"
    assert own.asset("car-sedan") is asset("car-sedan")
    # The others are who they are without it, or one of the table all the same.
    assert all(asset(name).actor_class == "van" for name in names if name != "own-cube")


def test_cars_of_north_america_have_its_plates_and_reflectors_and_nobody_elses_have():
    shown = {
        country: {
            AssetName.of(Fleet(country, 3).body(kind, n)).body
            for n in range(120)
            for kind in ("car", "van")
        }
        for country in ("US", "DE", "JP")
    }
    assert all(one.endswith("-american") for one in shown["US"] if "with" not in one)
    assert not any("american" in one for country in ("DE", "JP") for one in shown[country])
    # The same body but for them: as large, and of the same class.
    for one in sorted(shown["US"])[:4]:
        usual = asset(one.removesuffix("-american"))
        found = asset(one)
        assert found.actor_class == usual.actor_class
        size = [usual.length, usual.width, usual.height]
        assert [found.length, found.width, found.height] == pytest.approx(size)
        assert not np.array_equal(asset_mesh(one).material, asset_mesh(usual.name).material)
