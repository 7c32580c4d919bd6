"""The actor catalogue: sizes, closed surfaces, closed forms, and a gait that walks."""

from functools import cache
from importlib.resources import files

import numpy as np
import open3d as o3d
import pytest
import yaml
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from scipy.spatial import cKDTree

from urbantwin.errors import InputError
from urbantwin.taxonomy import ACTOR_CLASSES, ACTOR_SEMANTICS, material_id, semantic_id
from urbantwin.traffic.assets import asset, asset_mesh, asset_names, bodies_of_asset
from urbantwin.traffic.assets.gait import joint_angles
from urbantwin.traffic.assets.heavy import tram_entries
from urbantwin.traffic.assets.shell import Panel, Section, arched_outline, shell
from urbantwin.traffic.assets.solid import (
    box,
    capsule,
    cylinder,
    ellipsoid,
    loft,
    ring,
    superellipse,
    turned,
)


def _shown(name):
    return [body.asset for body in bodies_of_asset(name)] or [name]


WHOLE = [name for actor_class in ACTOR_CLASSES for name in asset_names(actor_class)]
#: Vehicles that bend are seen as their bodies.
NAMES = [shown for name in WHOLE for shown in _shown(name)]
WALKERS = [name for name in asset_names("pedestrian") if asset(name).stride_m > 0]
ANIMALS = asset_names("animal")
WHEELED = [name for name in NAMES if name not in (*WALKERS, *ANIMALS)]


@cache
def sizes():
    folder, entries = files("urbantwin.traffic.assets"), tram_entries()
    for name in ("assets.yaml", "cars.yaml", "light.yaml", "articulated.yaml"):
        entries |= yaml.safe_load(folder.joinpath(name).read_text())
    return {name: entry.get("size") for name, entry in entries.items()}


def all_phases(name):
    return sorted({*range(asset(name).phases), asset(name).standing})


def first_hits(mesh, origins, direction):
    """Return which faces (N,) parallel rays hit first, -1 for none."""
    scene = EmbreeScene(robust=True)
    keep = TriangleMesh(scene, mesh.vertices.astype(np.float32), mesh.faces)
    rays = np.broadcast_to(np.asarray(direction, np.float32), origins.shape).copy()
    hits = scene.run(origins.astype(np.float32), rays, output=True)
    del keep
    return np.where(hits["geomID"] >= 0, hits["primID"].astype(np.int64), -1)


# --- the catalogue ---


@pytest.mark.parametrize(
    ("actor_class", "least"),
    [
        ("car", 25),
        ("van", 5),
        ("truck", 3),
        ("bus", 1),
        ("motorcycle", 1),
        ("bicycle", 1),
        ("pedestrian", 4),
        ("tram", 1),
        ("trailer", 2),
        ("animal", 2),
    ],
)
def test_every_class_has_variety(actor_class, least):
    names = asset_names(actor_class)
    assert len(names) >= least
    assert all(asset(name).actor_class == actor_class for name in names)


def test_unknown_names_are_refused():
    with pytest.raises(InputError, match="airship"):
        asset_names("airship")
    with pytest.raises(InputError, match="car-nova"):
        asset("car-nova")
    with pytest.raises(InputError, match="no phase 3"):
        asset_mesh("car-sedan", 3)


@pytest.mark.parametrize("name", WHEELED)
def test_bounds_are_those_of_the_catalogue(name):
    vertices = asset_mesh(name).vertices
    np.testing.assert_allclose(np.ptp(vertices, axis=0), sizes()[name], atol=1e-3)
    found = asset(name)
    np.testing.assert_allclose([found.length, found.width, found.height], sizes()[name], atol=1e-3)


@pytest.mark.parametrize("name", NAMES)
def test_the_origin_lies_on_the_ground_under_the_middle(name):
    vertices = asset_mesh(name).vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    np.testing.assert_allclose((low + high)[:2], 0, atol=1e-9)
    for phase in all_phases(name):
        assert asset_mesh(name, phase).vertices[:, 2].min() == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("name", WHEELED)
def test_wheels_touch_the_ground_where_the_contacts_say(name):
    mesh = asset_mesh(name)
    touching = mesh.vertices[mesh.vertices[:, 2] < 1e-6]
    contacts = asset(name).contacts
    for contact in contacts:
        under = touching[np.abs(touching[:, 0] - contact[0]) < 0.01]
        assert under[:, 1].min() - 0.01 <= contact[1] <= under[:, 1].max() + 0.01
    # Nothing else touches it.
    assert np.abs(touching[:, :1] - contacts[:, 0]).min(axis=1).max() < 0.01
    # The wheels stayed round when the mesh was fitted to the catalogue's size.
    for part in np.unique(mesh.part[(mesh.triangles()[..., 2] < 1e-6).any(axis=1)]):
        extent = np.ptp(mesh.select(mesh.part == part).vertices, axis=0)
        assert extent[0] == pytest.approx(extent[2], rel=0.015)


@pytest.mark.parametrize("name", NAMES)
def test_labels_are_those_of_the_class(name):
    mesh = asset_mesh(name)
    assert set(mesh.semantic) == {semantic_id(ACTOR_SEMANTICS[asset(name).actor_class])}
    has = {key: material_id(key) in mesh.material for key in ("glass", "rubber", "cloth", "skin")}
    person = asset(name).actor_class in ("pedestrian", "bicycle", "motorcycle")
    alive = name in (*WALKERS, *ANIMALS)
    assert has["skin"] == person
    assert has["glass"] or asset(name).actor_class in ("pedestrian", "bicycle", "animal")
    assert has["rubber"]
    assert has["cloth"] or asset(name).actor_class == "trailer"
    assert (material_id("retroreflector") in mesh.material) == (not alive)


def seen_cm2(mesh, material, ahead):
    """What parallel rays along a direction of the axes meet of a material, square centimetres."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32))
    aside, up = np.meshgrid(np.arange(-7.0, 7.0, 0.01), np.arange(0.1, 2.0, 0.01))
    across = np.array([-ahead[1], ahead[0], 0.0])
    start = aside.ravel()[:, None] * across + up.ravel()[:, None] * [0, 0, 1] - 30.0 * ahead
    rays = np.column_stack([start, np.tile(ahead, (len(start), 1))]).astype(np.float32)
    face = scene.cast_rays(rays)["primitive_ids"].numpy()
    face = face[face < len(mesh.faces)]
    return int((mesh.material[face] == material_id(material)).sum())


@pytest.mark.parametrize(
    ("name", "rear", "side"),
    [
        ("car-supermini", 2, 0),
        ("car-offroad", 2, 0),
        ("car-pickup-full-american", 2, 2),  # sold in North America: FMVSS 108
        ("car-sedan", 2, 0),
        ("car-sedan-american", 2, 2),
        ("van-large-american", 2, 2),
        ("van-large", 2, 0),
        ("bus-city", 2, 5),  # 12 m: one at most 3 m behind the nose, at most 3 m apart
    ],
)
def test_reflectors_are_seen_from_behind_and_from_the_side(name, rear, side):
    """40 cm2 each (UN Regulation 48), not sunk into what they are fixed to; and tail lamps."""
    mesh = asset_mesh(name)
    seen = seen_cm2(mesh, "reflex-reflector", np.array([1.0, 0, 0]))
    assert 36 * rear <= seen <= 44 * rear + 10 * side
    lamps = seen_cm2(mesh, "lamp-lens", np.array([1.0, 0, 0]))
    assert lamps == pytest.approx(0 if name == "bus-city" else 2 * 280, rel=0.1)
    plate = seen_cm2(mesh, "retroreflector", np.array([1.0, 0, 0]))
    if name.endswith("american"):
        assert plate == pytest.approx(30.5 * 15.2, rel=0.1)
    else:
        assert plate == pytest.approx(52 * 11, rel=0.15)
    left = seen_cm2(mesh, "reflex-reflector", np.array([0, -1.0, 0]))
    assert 33 * side <= left <= 42 * side + 60  # the rear ones are seen on edge


@pytest.mark.parametrize("name", ["truck-rigid-26t", "trailer-curtain"])
def test_long_trucks_have_tape_along_their_sides(name):
    """UN Regulation 104: a band of 50 to 60 mm along most of the body."""
    mesh = asset_mesh(name)
    seen = seen_cm2(mesh, "retroreflector", np.array([0, -1.0, 0]))
    long_cm = 100 * np.ptp(mesh.vertices[:, 0])
    assert 0.6 * long_cm * 4 <= seen <= long_cm * 6


@pytest.mark.parametrize("name", NAMES)
def test_size_in_triangles(name):
    low, high = (800, 2500) if name in (*WALKERS, *ANIMALS) else (1500, 7000)
    if asset(name).actor_class == "trailer":
        low = 800
    assert low <= len(asset_mesh(name).faces) <= high


def test_the_same_mesh_is_built_again():
    for name in ("car-estate", "pedestrian-coat", "bicycle-city"):
        first = asset_mesh(name, 0)
        again = asset_mesh.__wrapped__(name, 0)
        assert first.vertices.tobytes() == again.vertices.tobytes()
        assert first.faces.tobytes() == again.faces.tobytes()


# --- surfaces ---


@pytest.mark.parametrize("name", NAMES)
def test_every_part_is_a_closed_surface_with_outward_normals(name):
    for phase in all_phases(name):
        mesh = asset_mesh(name, phase)
        edges = np.concatenate(
            [mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]
        )
        forward = edges[:, 0].astype(np.int64) * len(mesh.vertices) + edges[:, 1]
        backward = edges[:, 1].astype(np.int64) * len(mesh.vertices) + edges[:, 0]
        assert len(np.unique(forward)) == len(forward)
        np.testing.assert_array_equal(np.sort(forward), np.sort(backward))
        a, b, c = np.moveaxis(mesh.triangles(), 1, 0)
        cone = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        assert np.bincount(mesh.part, weights=cone)[1:].min() > 0
        assert mesh.areas().min() > 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_from_outside_only_outward_faces_are_seen(name):
    mesh = asset_mesh(name)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    for axis in range(3):
        u, v = [k for k in range(3) if k != axis]
        # Steps that no edge of the meshes follows.
        grid = np.stack(
            np.meshgrid(
                np.arange(low[u] + 0.0113, high[u], 0.0471),
                np.arange(low[v] + 0.0117, high[v], 0.0473),
            ),
            -1,
        ).reshape(-1, 2)
        for sign in (1, -1):
            origins = np.zeros((len(grid), 3))
            origins[:, [u, v]], origins[:, axis] = grid, -20.0 * sign
            direction = np.zeros(3)
            direction[axis] = sign
            faces = first_hits(mesh, origins, direction)
            assert (mesh.normals()[faces[faces >= 0]] @ direction).max() < 1e-3


@pytest.mark.parametrize("name", asset_names("car"))
def test_the_side_of_a_car_shows_windows_and_wheels_and_no_hole(name):
    mesh = asset_mesh(name)
    size = asset(name)
    x, z = np.meshgrid(
        np.arange(-size.length / 2, size.length / 2, 0.02), np.arange(0.01, size.height, 0.02)
    )
    origins = np.column_stack([x.ravel(), np.full(x.size, 5.0), z.ravel()])
    faces = first_hits(mesh, origins, [0, -1, 0])
    seen = mesh.material[faces[faces >= 0]]
    assert 0.08 < np.mean(seen == material_id("glass")) < 0.30
    assert 0.03 < np.mean(seen == material_id("rubber")) < 0.15
    # Above the sill and under the bonnet no ray passes from side to side: arches are closed.
    body = (origins[:, 2] > 0.40) & (origins[:, 2] < 0.60)
    body &= np.abs(origins[:, 0]) < 0.46 * size.length
    assert (faces[body] >= 0).all()


# --- primitives against closed forms ---


def polygon_share(sides):
    """Return the area of a regular polygon as a part of its circle's."""
    return sides / (2 * np.pi) * np.sin(2 * np.pi / sides)


def test_box_volume():
    assert box([2, 3, 4], [5, 6, 7], "cloth").volume() == pytest.approx(24)


@pytest.mark.parametrize("sides", [6, 12, 40])
@pytest.mark.parametrize("end", [[1, 2, 3], [0, 5, 0], [0, -5, 0], [0, 0, -2]])
def test_cylinder_volume(sides, end):
    found = cylinder([0, 0, 0], end, 0.3, "cloth", sides).volume()
    exact = np.pi * 0.3**2 * np.linalg.norm(end)
    assert found == pytest.approx(exact * polygon_share(sides))


def test_capsule_volume_converges_to_the_closed_form():
    r, s, h = 0.2, 0.1, 0.8
    exact = np.pi * h / 3 * (r * r + r * s + s * s) + 2 / 3 * np.pi * (r**3 + s**3)
    coarse, fine = (
        exact - capsule([0, 0, 0], [0, 0, h], r, s, "cloth", sides=n, cap_rings=n // 4).volume()
        for n in (12, 24)
    )
    assert 0 < fine < coarse < 0.07 * exact
    assert coarse / fine == pytest.approx(4, rel=0.1)


def test_ellipsoid_and_ring_volumes_converge_to_the_closed_forms():
    exact = 4 / 3 * np.pi * 0.5 * 0.4 * 0.3
    found = ellipsoid([0.5, 0.4, 0.3], [1, 2, 3], "cloth", sides=96, rings=63).volume()
    assert exact * 0.997 < found < exact
    # A ring of outer radius R + r: 2 pi^2 R r^2 (Pappus).
    exact = 2 * np.pi**2 * 0.3 * 0.05**2
    found = ring([0, 0, 0], 0.35, 0.10, "rubber", sides=96, section_sides=48).volume()
    assert found == pytest.approx(exact, rel=0.005)


def test_turned_and_lofted_cones_agree_with_the_closed_form():
    exact = np.pi * 0.5**2 * 2 / 3
    found = turned([[0, 0], [0.5, 0], [0, 2]], "cloth", sides=60).volume()
    assert found == pytest.approx(exact * polygon_share(60))
    oval = superellipse(0.4, 0.2, sides=40)
    frustum = [
        np.column_stack([oval * scale, np.full(40, z)]) for scale, z in ((1.0, 0.0), (0.5, 3.0))
    ]
    exact = np.pi * 0.4 * 0.2 * 3 / 3 * (1 + 0.5 + 0.25)
    assert loft(frustum, "cloth").volume() == pytest.approx(exact * polygon_share(40))


def test_a_shell_of_constant_width_is_its_profile_times_the_width():
    upper = [(2.0, 0.3, "dark"), (2.0, 0.9, "paint"), (0.5, 1.5, "paint"), (-2.0, 1.5, "paint")]
    upper.append((-2.0, 0.3, "under"))
    outline = arched_outline(upper, [-1.2, 1.3], arch_centre_z=0.35, arch_radius=0.4)
    window = Panel(((-1.5, 1.0), (0.0, 1.0), (0.0, 1.4), (-1.5, 1.4)), "glass", side="left")
    flat = Section(0.9, ((0.0, 1.0), (2.0, 1.0)), ((-2.0, 1.0), (2.0, 1.0)), edge_radius=1e-6)
    body = shell(outline, flat, [window])
    assert body.volume() == pytest.approx(outline.polygon().area * 1.8, rel=1e-4)
    # Each arch takes the part of its disc that lies above the floor, here a circular segment.
    rise = 0.4 + 0.05
    segment = 0.4**2 * np.arccos(-0.05 / 0.4) + 0.05 * np.sqrt(0.4**2 - 0.05**2)
    whole = 4.0 * 1.2 - 0.5 * 1.5 * 0.6
    assert outline.polygon().area == pytest.approx(whole - 2 * segment, rel=0.01)
    assert outline.points[:, 1].min() == pytest.approx(0.3)
    assert rise < 0.5
    # The window is glass on the left side only.
    triangles = body.vertices[body.faces]
    area = np.linalg.norm(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
    )
    glass = body.material == material_id("glass")
    assert area[glass].sum() / 2 == pytest.approx(1.5 * 0.4)
    assert triangles[glass][..., 1].min() == pytest.approx(0.9)


# --- walking ---


@pytest.mark.parametrize("name", WALKERS)
def test_half_a_cycle_apart_left_and_right_are_exchanged(name):
    half = asset(name).phases // 2
    for phase in range(half):
        here = asset_mesh(name, phase).vertices * [1, -1, 1]
        there = asset_mesh(name, phase + half).vertices
        assert len(here) == len(there)
        assert cKDTree(here).query(there)[0].max() < 1e-9
        assert cKDTree(there).query(here)[0].max() < 1e-9


@pytest.mark.parametrize("name", WALKERS)
def test_feet_on_the_ground_stay_where_they_are(name):
    found = asset(name)
    step = found.stride_m / found.phases
    meshes = [asset_mesh(name, phase) for phase in range(found.phases)]
    soles = np.unique(meshes[0].faces[meshes[0].material == material_id("rubber")])
    places = np.array([mesh.vertices[soles] for mesh in meshes])
    drift = []
    for now, after in zip(places, np.roll(places, -1, axis=0), strict=True):
        planted = (now[:, 2] < 0.012) & (after[:, 2] < 0.012)
        assert planted.any()
        drift.append((after - now)[planted][:, 0].mean() + step)
    # In a step of a cycle's twelfth, some 12 cm, a sole on the ground slips by less than 2 cm.
    assert np.abs(drift).max() < 0.16 * step
    assert abs(np.sum(drift)) < 0.05 * found.stride_m


@pytest.mark.parametrize("name", ANIMALS)
def test_paws_on_the_ground_stay_where_they_are(name):
    """Of a dog's four feet those that stand go back as fast as it goes on."""
    found = asset(name)
    step = found.stride_m / found.phases
    meshes = [asset_mesh(name, phase) for phase in range(found.phases)]
    paws = [
        part
        for part in np.unique(meshes[0].part)
        if np.ptp(meshes[0].select(meshes[0].part == part).vertices[:, 2]) < 0.06
        and any(mesh.select(mesh.part == part).vertices[:, 2].min() < 1e-6 for mesh in meshes)
    ]
    assert len(paws) == 4
    places = np.array(
        [[mesh.select(mesh.part == paw).vertices.min(axis=0) for paw in paws] for mesh in meshes]
    )
    for now, after in zip(places, np.roll(places, -1, axis=0), strict=True):
        planted = (now[:, 2] < 0.005) & (after[:, 2] < 0.005)
        assert planted.sum() >= 2
        np.testing.assert_allclose((after - now)[planted, 0], -step, atol=0.1 * step)


def test_strides_are_those_of_people():
    # Perry and Burnfield 2010, chapter 1: 1.41 m on average, men 1.46 m, women 1.28 m.
    assert asset("pedestrian-man").stride_m == pytest.approx(1.46, rel=0.06)
    assert asset("pedestrian-woman").stride_m == pytest.approx(1.28, rel=0.08)


@pytest.mark.parametrize("name", [name for name in WALKERS if name != "pedestrian-stroller"])
def test_arms_swing_against_legs_and_the_head_goes_straight_on(name):
    mesh = asset_mesh(name, 0)
    skin, rubber = (
        mesh.select(mesh.material == material_id(key)).vertices for key in ("skin", "rubber")
    )
    stature = asset(name).height
    hands = skin[skin[:, 2] < 0.7 * stature]
    left, right = (
        [part[part[:, 1] * side > 0][:, 0] for part in (rubber, hands)] for side in (1, -1)
    )
    assert left[0].mean() > right[0].mean() + 0.3 * stature
    assert left[1].mean() < right[1].mean() - 0.1 * stature
    tops = [asset_mesh(name, k).vertices for k in range(asset(name).phases)]
    tops = np.array([v[v[:, 2].argmax()] for v in tops])
    assert np.ptp(tops[:, 0]) < 1e-9
    # The head rises and falls, by no more than the 4 cm or so of real adults.
    assert 0.005 < np.ptp(tops[:, 2]) / stature < 0.03


def test_knees_bend_as_people_do():
    angles = np.degrees([joint_angles(part) for part in np.linspace(0, 1, 201)])
    thigh, knee, ankle = angles.T
    # Between the published values the curve must not overshoot them.
    assert -22 < thigh.min() < -18
    assert 23 < thigh.max() < 27
    assert 0 <= knee.min() < 6
    assert 58 < knee.max() < 66
    assert 0.70 < np.argmax(knee) / 200 < 0.78
    assert ankle.min() > -18
    assert ankle.max() < 15


@pytest.mark.parametrize("name", [*asset_names("bicycle"), *asset_names("motorcycle")])
def test_halted_riders_put_a_foot_down(name):
    def feet(phase):
        mesh = asset_mesh(name, phase)
        low = mesh.select(mesh.material == material_id("rubber")).vertices
        return low[(np.abs(low[:, 1]) > 0.15) & (low[:, 2] < 0.01)]

    assert len(feet(asset(name).standing))
    assert not len(feet(0))
