"""Coats of vehicles: their shares, and what they change of a mesh."""

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.taxonomy import material_id, materials
from urbantwin.traffic.assets import COATS, asset, asset_mesh, asset_names, coated_name

PAINTED = material_id("metal-painted")


def test_coats_come_in_their_shares_among_few_and_many():
    for count in (19, 190, 1900):
        for kind, shares in (("car", COATS), ("van", {"white": 0.57, "grey": 0.1, "black": 0.33})):
            names = [coated_name(f"{kind}-one", number, kind) for number in range(count)]
            for coat, share in shares.items():
                found = sum(name.endswith(f"_{coat}") for name in names)
                assert abs(found - share * count) <= 2


@pytest.mark.parametrize("name", [*asset_names("car"), *asset_names("truck"), *asset_names("bus")])
def test_a_coat_changes_what_is_painted_and_panes_and_nothing_else(name):
    bare = asset_mesh(name)
    for coat in COATS:
        mesh = asset_mesh(f"{name}_{coat}")
        np.testing.assert_array_equal(mesh.vertices, bare.vertices)
        np.testing.assert_array_equal(mesh.faces, bare.faces)
        changed = mesh.material != bare.material
        panes = bare.material == material_id("glass")
        np.testing.assert_array_equal(changed & ~panes, bare.material == PAINTED)
        assert set(mesh.material[changed & ~panes]) == {material_id(f"paint-{coat}")}
        tinted = {material_id("glass-tinted"), material_id("glass-privacy")}
        assert set(mesh.material[changed & panes]) <= tinted
        assert asset(f"{name}_{coat}").length == asset(name).length


def test_a_dark_coat_sends_back_little():
    table = materials()
    dark, grey, white = (table[f"paint-{coat}"].reflectivity for coat in ("black", "grey", "white"))
    assert dark < 0.1 < grey < 0.3 < white


def test_people_have_no_coat_and_unknown_coats_are_refused():
    for name in ("pedestrian-man_black", "car-sedan_pink", "car-nova_black"):
        with pytest.raises(InputError, match="unknown asset"):
            asset_mesh(name)


def test_panes_are_tinted_and_lamps_are_not() -> None:
    """Behind the front seats a black car is darker than a white one; glass low down is lamps."""
    named = {name: material_id(name) for name in ("glass", "glass-tinted", "glass-privacy")}
    for coat, rear in (("white", "glass-tinted"), ("black", "glass-privacy")):
        mesh = asset_mesh(f"car-sedan_{coat}")
        bare = asset_mesh("car-sedan")
        was_glass = bare.material == named["glass"]
        middle = bare.triangles().mean(axis=1)
        low = was_glass & (middle[:, 2] < 0.5 * bare.vertices[:, 2].max())
        behind = was_glass & (middle[:, 0] < -0.3) & (middle[:, 2] > 1.1)
        ahead = was_glass & (middle[:, 0] > 0.7) & (middle[:, 2] > 1.0)
        assert behind.any()
        assert ahead.any()
        assert (mesh.material[low] == named["glass"]).all()
        assert (mesh.material[behind] == named[rear]).all()
        assert (mesh.material[ahead] == named["glass-tinted"]).all()
        assert not np.isin(mesh.material[~was_glass], list(named.values())).any()
