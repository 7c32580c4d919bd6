"""The twin as a whole: reproducible, complete, honest about damage."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import DownwardProbe
from urbantwin.scene import PARTS
from urbantwin.site import load_site
from urbantwin.taxonomy import materials, semantic_classes
from urbantwin.twin import build_twin, load_twin

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"


@pytest.fixture
def twin(two_avenues_twin):
    return two_avenues_twin


def bridge_site(tmp_path, write_osm):
    nodes = {1: (-300, 0, {}), 2: (-40, 0, {}), 3: (40, 0, {}), 4: (300, 0, {})}
    nodes |= {5: (0, -200, {}), 6: (0, 200, {})}
    over = {"highway": "primary", "lanes": "2"}
    write_osm(
        nodes,
        {
            1: ([1, 2], over),
            2: ([2, 3], {**over, "bridge": "yes", "layer": "1"}),
            3: ([3, 4], over),
            4: ([5, 6], {"highway": "residential"}),
        },
    )
    text = (EXAMPLE / "site.yaml").read_text().split("osm:")[0]
    rig = "rig:\n  sensors:\n    - {name: a, model: VLP-16, east_m: 12, north_m: 12, height_m: 4}\n"
    path = tmp_path / "site.yaml"
    path.write_text(f"{text}osm: map.osm\ntraffic: {{}}\n{rig}")
    return path


@pytest.mark.thorough
def test_same_site_same_bytes(twin, tmp_path):
    again = build_twin(load_site(EXAMPLE / "site.yaml"), tmp_path / "twin")
    names = sorted(path.name for path in twin.folder.iterdir())
    assert names == sorted(path.name for path in again.folder.iterdir())
    for name in names:
        assert (twin.folder / name).read_bytes() == (again.folder / name).read_bytes(), name


def test_nothing_in_it_names_a_folder_of_this_machine(twin):
    for path in twin.folder.iterdir():
        assert str(EXAMPLE.parent).encode() not in path.read_bytes(), path.name


def test_every_triangle_has_a_class_and_a_material(twin):
    known = {c.id for c in semantic_classes().values()} - {0}
    assert set(np.unique(twin.mesh.semantic).tolist()) <= known
    assert twin.mesh.material.min() >= 1
    assert twin.mesh.material.max() < len(materials())
    assert np.isfinite(twin.mesh.vertices).all()
    assert (twin.mesh.areas() > 0).all()


def test_the_example_has_what_it_was_drawn_with(twin):
    area = twin.mesh.areas()
    assert area[twin.mesh.part == PARTS["island"]].sum() > 100  # the median
    found = {name for name, c in semantic_classes().items() if (twin.mesh.semantic == c.id).any()}
    assert {"road", "sidewalk", "terrain", "building", "pole", "vegetation", "trunk"} <= found
    assert len(twin.roads.programs) >= 1


def test_the_ground_is_on_the_dem(twin):
    """Reference lines lie on the DEM, a smooth slope, within 3 cm; lanes, which fall from a crown,
    on the mesh within 2 cm, whatever triangles it is made of."""
    streets = [road for road in twin.lane_model.roads if road.junction < 0]
    points = np.concatenate(
        [road.place(np.linspace(0.0, road.length, 40), 0.0) for road in streets]
    )
    inside = twin.region.buffer(-1)
    points = points[shapely.contains_xy(inside, points[:, 0], points[:, 1])]
    assert np.abs(points[:, 2] - twin.elevation.raw_at(points[:, :2])).max() < 0.03
    lanes = [lane for lane in twin.roads.lanes if lane.kind == "driving"]
    points = np.concatenate([lane.centre for lane in lanes])
    points = points[shapely.contains_xy(inside, points[:, 0], points[:, 1])]
    height = DownwardProbe(twin.ground_mesh).height_below(points + [0, 0, 1.0])
    assert np.abs(height - points[:, 2]).max() < 0.02


def test_a_changed_file_is_noticed(twin, tmp_path):
    copy = tmp_path / "copy"
    shutil.copytree(twin.folder, copy)
    (copy / "roads.json").write_text("{}")
    with pytest.raises(InputError, match=r"roads\.json: was changed"):
        load_twin(copy)
    (copy / "roads.json").unlink()
    with pytest.raises(InputError, match=r"roads\.json: is missing"):
        load_twin(copy)


def test_another_folder_is_not_a_twin(tmp_path):
    with pytest.raises(InputError, match=r"twin\.json: not found"):
        load_twin(tmp_path)
    (tmp_path / "twin.json").write_text(json.dumps({"kind": "motion"}))
    with pytest.raises(InputError, match="is not a twin's"):
        load_twin(tmp_path)


def test_somebodys_folder_is_not_overwritten(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        build_twin(load_site(EXAMPLE / "site.yaml"), tmp_path / "out")
    assert (tmp_path / "out" / "thesis.txt").read_text() == "mine"


def test_a_failed_build_leaves_nothing(tmp_path, write_osm):
    site = bridge_site(tmp_path, write_osm)
    write_osm({1: (0, 0, {}), 2: (50, 0, {})}, {1: ([1, 2], {"highway": "footway"})})
    with pytest.raises(InputError, match="no streets"):
        build_twin(load_site(site), tmp_path / "out" / "twin")
    assert not (tmp_path / "out").exists()


def test_traffic_passes_under_a_bridge_and_over_it(tmp_path, write_osm):
    twin = build_twin(load_site(bridge_site(tmp_path, write_osm)), tmp_path / "twin")
    probe = DownwardProbe(twin.ground_mesh)
    xs = np.linspace(-2, 2, 9)
    deck = probe.height_below(np.column_stack([xs, xs * 0, xs * 0 + 50]))
    assert (deck > 4.7).all()
    street = probe.height_below(np.column_stack([xs, xs * 0, xs * 0 + 2]))
    assert np.abs(street).max() < 0.2
    # Driving along the bridge there is no step anywhere from one end to the other.
    along = np.arange(-125, 125, 0.5)
    z = probe.height_below(np.column_stack([along, along * 0 - 1.5, along * 0 + 50]))
    assert np.abs(np.diff(z)).max() < 0.06
