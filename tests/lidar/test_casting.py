"""Ranges against closed forms."""

import numpy as np
import pytest

from urbantwin.geometry import LabelledMesh
from urbantwin.geometry.rays import RayScene
from urbantwin.taxonomy import material_id, materials, semantic_id

from ..thin_rays import cast_static

RNG = np.random.default_rng(3)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def rough(material, wavelength, cosine):
    """Oren and Nayar's equation 30 with light and view along one line, and beads on top."""
    slope = np.radians(material.roughness_deg) ** 2
    a, b = 1 - 0.5 * slope / (slope + 0.33), 0.45 * slope / (slope + 0.09)
    angle = np.arccos(cosine)
    shape = np.cos(angle) * (a + b * np.sin(angle) * np.tan(angle))
    return material.reflectivity_at(wavelength) * shape + material.retro


def test_plane_at_closed_form_range(ground_mesh):
    origin = np.array([3.0, -2.0, 7.5])
    directions = unit(RNG.normal(size=(5000, 3)))
    hits = cast_static(ground_mesh(half=400.0), origin, directions)
    down = directions[:, 2] < 0
    expected = np.where(down, -origin[2] / np.where(down, directions[:, 2], 1), np.inf)
    place = origin + directions * np.where(down, expected, 0)[:, None]
    inside = down & (np.abs(place[:, :2]) < 399.9).all(axis=1)
    assert inside.sum() > 2000
    np.testing.assert_allclose(hits.range_m[inside], expected[inside], rtol=1e-6)
    assert np.isinf(hits.range_m[~down]).all()
    np.testing.assert_allclose(hits.cosine[inside], -directions[inside, 2], atol=1e-6)
    assert (hits.semantic[inside] == semantic_id("road")).all()
    assert (hits.backscatter[~down] == 0).all()
    expected = rough(materials()["asphalt"], 905.0, -directions[inside, 2])
    np.testing.assert_allclose(hits.backscatter[inside], expected, rtol=1e-4)


@pytest.mark.parametrize("offset", [0.0, 1500.0])
def test_box_at_closed_form_range_wherever_it_stands(box_mesh, offset):
    """The slab method, also for a world far from the anchor."""
    low, high = np.array([2.0, -1.0, -1.5]) + offset, np.array([5.0, 2.0, 1.0]) + offset
    origin = np.array([-4.0, 0.3, 0.2]) + offset
    targets = RNG.uniform(low - 1, high + 1, size=(20000, 3))
    directions = unit(targets - origin)
    one, other = (low - origin) / directions, (high - origin) / directions
    enter = np.minimum(one, other).max(axis=1)
    leave = np.maximum(one, other).min(axis=1)
    hits = cast_static(box_mesh(low, high), origin, directions)
    clear = np.abs(leave - enter) > 1e-3  # Rays along an edge may be seen either way.
    assert clear.mean() > 0.99
    hit = enter < leave
    assert hit.sum() > 3000
    np.testing.assert_array_equal((hits.face >= 0)[clear], hit[clear])
    np.testing.assert_allclose(hits.range_m[hit & clear], enter[hit & clear], atol=2e-6)


def test_cylinder_at_closed_form_range():
    """A fine prism lies between the circles of its corners and of its edges' middles."""
    sides, radius, height = 720, 0.6, 4.0
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
    vertices = np.vstack(
        [np.column_stack([ring, np.full(sides, z)]) for z in (-height / 2, height / 2)]
    )
    i = np.arange(sides)
    j = (i + 1) % sides
    faces = np.vstack(
        [np.column_stack([i, j, j + sides]), np.column_stack([i, j + sides, i + sides])]
    )
    mesh = LabelledMesh.build(vertices, faces, semantic_id("pole"), material_id("metal-painted"))
    origin = np.array([-10.0, 1.0, 0.4])
    directions = unit(
        np.column_stack(
            [np.ones(4000), RNG.uniform(-0.2, 0.05, 4000), RNG.uniform(-0.1, 0.1, 4000)]
        )
    )
    flat = directions[:, :2]
    a = (flat**2).sum(1)
    b = (flat * origin[:2]).sum(1)

    def entry(r):
        root = b * b - a * (origin[:2] @ origin[:2] - r * r)
        return np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)

    outer, inner = entry(radius), entry(radius * np.cos(np.pi / sides))
    hits = cast_static(mesh, origin, directions)
    sure = np.isfinite(inner)
    assert sure.sum() > 1000
    assert (hits.range_m[sure] >= outer[sure] - 2e-6).all()
    assert (hits.range_m[sure] <= inner[sure] + 2e-6).all()
    assert np.isinf(hits.range_m[np.isinf(outer)]).all()


def test_nothing_is_hit_in_an_empty_world():
    directions = unit(RNG.normal(size=(10, 3)))
    hits = cast_static(LabelledMesh.empty(), np.zeros(3), directions)
    assert (hits.face == -1).all()
    assert np.isinf(hits.range_m).all()
    found = RayScene(np.zeros((0, 3)), np.zeros((0, 3), np.int32)).cast(
        np.zeros(3), directions.astype(np.float32)
    )
    assert (found.face == -1).all()


def test_no_ray_slips_through_the_edges_of_a_closed_surface(box_mesh):
    """Rays from inside aimed exactly at corners, edges and the diagonals between triangles."""
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T.astype(float)
    pairs = np.array([(i, j) for i in range(8) for j in range(i)])
    share = np.linspace(0, 1, 201)[:, None, None]
    aims = (corners[pairs[:, 0]] * share + corners[pairs[:, 1]] * (1 - share)).reshape(-1, 3)
    aims = aims[np.abs(aims).max(axis=1) > 0.999]
    hits = cast_static(box_mesh((-1, -1, -1), (1, 1, 1)), np.zeros(3), unit(aims))
    assert (hits.face >= 0).all()
    np.testing.assert_allclose(hits.range_m, np.linalg.norm(aims, axis=1), atol=1e-6)


@pytest.mark.parametrize("name", ["foliage", "skin", "water", "road-paint"])
@pytest.mark.parametrize("wavelength", [865.0, 905.0, 1550.0])
def test_backscatter_is_that_of_the_sensors_wavelength(ground_mesh, name, wavelength):
    """At the table's wavelengths, straight down and at a slant, worked out from the table."""
    directions = unit(np.array([[0.0, 0.0, -1.0], [5.0, 0.0, -1.0]]))
    hits = cast_static(
        ground_mesh(material=name),
        np.array([0.0, 0.0, 5.0]),
        directions,
        wavelength_nm=wavelength,
    )
    expected = rough(materials()[name], wavelength, -directions[:, 2])
    np.testing.assert_allclose(hits.backscatter, expected, rtol=1e-4)


def test_beads_keep_paint_bright_where_asphalt_fades(ground_mesh):
    """EN 1436's geometry: light at 88.76 degrees from the normal; below 100 mcd per m2 and lx."""
    slant = np.radians(88.76)
    direction = np.array([[np.sin(slant), 0.0, -np.cos(slant)]])
    origin = np.array([-100.0, 0.0, 2.0])
    paint, asphalt = (
        cast_static(ground_mesh(half=500.0, material=name), origin, direction).backscatter[0]
        for name in ("road-paint", "asphalt")
    )
    assert 0.015 < paint / np.pi < 0.1
    assert paint > 1.5 * asphalt
    assert 0.005 < asphalt / np.pi < 0.03  # what roads without lines have
