import json

import numpy as np
import pytest

from urbantwin.taxonomy import (
    ACTOR_CLASSES,
    ACTOR_SEMANTICS,
    WAVELENGTHS_NM,
    materials,
    semantic_classes,
    semantic_id,
)

#: Learning map of SemanticKITTI, config/semantic-kitti.yaml: label -> name (the classes we use).
SEMANTIC_KITTI = {
    1: "outlier",
    10: "car", 13: "bus", 15: "motorcycle", 16: "on-rails", 18: "truck", 30: "person",
    31: "bicyclist",
    32: "motorcyclist", 40: "road", 44: "parking", 48: "sidewalk", 49: "other-ground",
    50: "building", 51: "fence", 52: "other-structure", 70: "vegetation", 71: "trunk",
    72: "terrain", 80: "pole", 81: "traffic-sign", 99: "other-object",
}  # fmt: skip


def test_numbers_are_semantic_kittis():
    ours = {c.id: c.name for c in semantic_classes().values() if c.id}
    assert {**ours, 30: "person"} == SEMANTIC_KITTI


def test_every_actor_class_has_a_countable_semantic_class():
    for name in ACTOR_CLASSES:
        # SemanticKITTI knows no animals.
        assert semantic_classes()[ACTOR_SEMANTICS[name]].thing or name == "animal"
    assert semantic_id("unlabelled") == 0


def test_materials_are_numbered_in_order_and_physical():
    table = list(materials().values())
    assert [m.id for m in table] == list(range(len(table)))
    for material in table:
        assert all(0 < value <= 1 for value in material.reflectivities)
        assert 0 <= material.transmission < 1
        # pi times the coefficients of EN 12899-1 and ASTM D4956 (sheeting), of EN 1436 (beads), of
        # UN Regulation 3 (prisms); lenses of lamps were measured between 1.5 and 4.4.
        laws = {"none": (0, 0), "beads": (0.01, 4.4), "sheeting": (150, 2200)}
        low, high = (laws | {"prisms": (300, 2200)})[material.retro_law]
        assert low <= material.retro <= high
        assert 0 <= material.roughness_deg < 45
        assert material.basis in ("measured", "modelled", "estimate")
        assert material.source


def test_numbers_that_twins_on_disk_use_never_change():
    """A scene.npz holds numbers: those of the first version, and of every later row, stay."""
    names = "unknown asphalt concrete paving grass soil brick plaster roofing glass foliage bark"
    names += " metal-painted metal-dark rubber cloth skin retroreflector wood"
    assert list(materials())[:19] == names.split()


#: Spectra of the ECOSTRESS library at 0.86, 0.88, 0.90, 0.92, 1.54 and 1.56 um, percent.
ECOSTRESS = {
    "grass": (49.974, 50.42, 50.79, 51.061, 23.15, 25.381),
    "foliage": (55.146, 55.395, 55.386, 55.393, 24.154, 26.352),
    "asphalt-light": (27.0293, 27.3743, 27.6779, 28.0185, 36.0593, 36.2701),
    "slate": (18.95, 18.96, 18.92, 18.99, 17.33, 17.27),
    "metal-bare": (54.47, 56.63, 59.1, 60.98, 81.21, 81.43),
}


@pytest.mark.parametrize("name", sorted(ECOSTRESS))
def test_measured_values_are_those_of_their_spectrum(name):
    percent = np.interp([0.865, 0.905, 1.55], [0.86, 0.88, 0.9, 0.92, 1.54, 1.56], ECOSTRESS[name])
    np.testing.assert_allclose(materials()[name].reflectivities, percent / 100, atol=0.01)


def test_dark_asphalt_is_that_of_openmaterial(shared_data):
    """Their table holds BRDF times the cosine of incidence, per steradian."""
    path = shared_data / "meshes/openmaterial/examples/example_material_lidar_brdf.xompt"
    rows = np.array(json.loads(path.read_text())["brdf"]["lookupTable"])
    assert set(rows[:, 0]) == {9.05e-7}
    inside = rows[:, 1] < np.radians(89.5)
    reflectivity = np.pi * rows[inside, 4] / np.cos(rows[inside, 1])
    assert np.ptp(reflectivity) < 0.001
    dark = materials()["asphalt-dark"].reflectivity
    assert dark == pytest.approx(reflectivity.mean(), abs=0.005)


def test_modelled_values_follow_fresnel():
    glass = ((1.51 - 1) / (1.51 + 1)) ** 2
    assert materials()["glass"].reflectivity == pytest.approx(2 * glass, abs=0.005)
    water = [((n - 1) / (n + 1)) ** 2 for n in (1.329, 1.328, 1.318)]
    np.testing.assert_allclose(materials()["water"].reflectivities, water, atol=0.002)


def test_reflectivity_between_and_beyond_the_wavelengths_of_the_table():
    foliage = materials()["foliage"]
    for wavelength, value in zip(WAVELENGTHS_NM, foliage.reflectivities, strict=True):
        assert foliage.reflectivity_at(wavelength) == pytest.approx(value)
    low, high = foliage.reflectivities[1:]
    assert foliage.reflectivity_at(1227.5) == pytest.approx((low + high) / 2)
    assert foliage.reflectivity_at(532) == foliage.reflectivities[0]
    assert foliage.reflectivity_at(2000) == foliage.reflectivities[2]


def test_what_has_to_stand_out_does():
    """Paint is brighter than any pavement, plants are dark at 1550 nm, water is darkest (but for
    black cars, whose clear coat mirrors as water does)."""
    table = materials()
    pavements = ("asphalt", "asphalt-dark", "asphalt-light", "concrete", "paving", "gravel")
    for wavelength in WAVELENGTHS_NM:
        paint = table["road-paint"].reflectivity_at(wavelength)
        assert paint > max(table[name].reflectivity_at(wavelength) for name in pavements)
        assert table["water"].reflectivity_at(wavelength) == min(
            m.reflectivity_at(wavelength)
            for m in table.values()
            if m.transmission == 0 and m.name != "paint-black"
        )
    for name in ("grass", "foliage", "foliage-needle"):
        assert table[name].reflectivity_at(1550) < 0.6 * table[name].reflectivity_at(905)
