"""Rasters of ground materials against shapely, and where rays meet them."""

import numpy as np
import pytest
import shapely

from urbantwin.geometry import LabelledMesh, MaterialLayer, SurfaceMaterials
from urbantwin.lidar.returns import scatter_of_materials
from urbantwin.scene.ground_material.rasterise import cells_of_quads, layer_of_cells
from urbantwin.taxonomy import material_id, materials, semantic_id

from ..thin_rays import cast_static

PAINT = material_id("road-paint")
CELL = 0.05


def flat(z=0.0):
    return lambda xy: np.full(len(xy), z)


def turned_boxes(count, seed, spread=30.0):
    """Rectangles and triangles of all sizes and ways around, on both sides of the axes."""
    rng = np.random.default_rng(seed)
    middle = rng.uniform(-spread, spread, (count, 1, 2))
    angle = rng.uniform(0, 2 * np.pi, count)
    size = rng.uniform([0.1, 0.5], [0.5, 6.0], (count, 2))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * size[:, None]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    quads = np.einsum("ijn,nkj->nki", turn, corners) + middle
    quads[::3] = quads[::3, ::-1]
    quads[1::5, 3] = quads[1::5, 2]
    return quads


def layer_of(quads, z=0.0, level=0, material=PAINT, within=None):
    cells = cells_of_quads(quads, CELL, within)
    return layer_of_cells(cells, material=material, level=level, cell_m=CELL, height=flat(z))


def test_a_point_has_paint_where_the_middle_of_its_cell_is_in_a_shape():
    quads = turned_boxes(120, seed=1)
    layer = layer_of(quads)
    shape = shapely.union_all(shapely.polygons(quads))
    shapely.prepare(shape)
    points = np.random.default_rng(2).uniform(-33, 33, (60_000, 2))
    middle = (np.floor(points / CELL) + 0.5) * CELL
    expected = shapely.contains_xy(shape, *middle.T)
    wrong = layer.covers(points) != expected
    # A middle on the very border may be seen either way.
    assert (shapely.distance(shapely.points(middle[wrong]), shape.boundary) < 1e-9).all()
    assert wrong.sum() < 5
    assert 0.01 < expected.mean() < 0.5
    assert layer.area == pytest.approx(shape.area, rel=0.01)


def test_cells_beyond_an_area_are_left_out():
    quads = turned_boxes(60, seed=3)
    area = shapely.Point(3.0, -4.0).buffer(17.0)
    inside = layer_of(quads, within=area)
    points = np.random.default_rng(4).uniform(-33, 33, (40_000, 2))
    middle = (np.floor(points / CELL) + 0.5) * CELL
    expected = layer_of(quads).covers(points) & shapely.contains_xy(area, *middle.T)
    np.testing.assert_array_equal(inside.covers(points), expected)
    assert expected.sum() > 100


def test_memory_follows_what_is_painted():
    """A line of 2 km takes kilobytes, not the megabytes of its surroundings."""
    line = np.array([[[-1000, -0.07], [1000, -0.07], [1000, 0.08], [-1000, 0.08]]])
    pieces = np.concatenate([line[:, :, :] * [0.001, 1] + [x, 0] for x in np.arange(-999, 1000, 2)])
    layer = layer_of(pieces)
    assert layer.area == pytest.approx(2000 * 0.15, rel=1e-6)
    assert layer.bits.nbytes < 1_000_000


@pytest.mark.parametrize("cell_m", [0.05, 0.2])
def test_saved_and_loaded_it_is_the_same_to_the_byte(tmp_path, cell_m):
    quads = turned_boxes(40, seed=5)
    layers = tuple(
        layer_of_cells(
            cells_of_quads(part, cell_m),
            material=number,
            level=level,
            cell_m=cell_m,
            height=flat(z),
        )
        for part, number, level, z in [(quads[:20], PAINT, 0, 0.0), (quads[20:], 4, 1, 6.0)]
    )
    surface = SurfaceMaterials(layers)
    surface.save(tmp_path / "a.npz")
    again = SurfaceMaterials.load(tmp_path / "a.npz")
    again.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    points = np.random.default_rng(6).uniform(-33, 33, (20_000, 2))
    np.testing.assert_array_equal(surface.at(points), again.at(points))
    assert set(surface.at(points)) == {0, PAINT, 4}
    assert [one.level for one in again.layers] == [0, 1]


def test_nothing_is_painted_on_an_empty_one(tmp_path):
    SurfaceMaterials().save(tmp_path / "none.npz")
    none = SurfaceMaterials.load(tmp_path / "none.npz")
    assert none.layers == ()
    assert (none.at(np.zeros((3, 3))) == 0).all()
    empty = SurfaceMaterials((layer_of(np.zeros((0, 4, 2))),))
    assert (empty.at([[0.0, 0.0], [1.0, 1.0]]) == 0).all()


def test_the_first_of_two_layers_counts():
    square = np.array([[[-1, -1], [1, -1], [1, 1], [-1, 1]]], float)
    both = SurfaceMaterials((layer_of(square * 0.5), layer_of(square, material=4)))
    assert both.at([[0, 0], [0.8, 0.8], [1.2, 0]]).tolist() == [PAINT, 4, 0]


def quad(half, z, semantic="road", material="asphalt", tilt=0.0):
    xy = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    vertices = np.column_stack([xy, z + tilt * xy[:, 0]])
    return LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id(semantic), material_id(material)
    )


def test_paint_of_a_bridge_is_not_on_the_street_below():
    """The street has a line along x, the bridge over it one along y; a slope of 5 % on both."""
    along = np.array([[[-20, -0.1], [20, -0.1], [20, 0.1], [-20, 0.1]]])
    height = [lambda xy: 0.05 * xy[:, 0], lambda xy: 6.0 + 0.05 * xy[:, 0]]
    surface = SurfaceMaterials(
        tuple(
            layer_of_cells(
                cells_of_quads(area, CELL), material=PAINT, level=level, cell_m=CELL, height=z
            )
            for level, (area, z) in enumerate(zip([along, along[..., ::-1]], height, strict=True))
        )
    )
    world = LabelledMesh.concatenate([quad(30, 0.0, tilt=0.05), quad(8, 6.0, tilt=0.05)])
    rng = np.random.default_rng(7)
    aims = np.column_stack([rng.uniform(-7.9, 7.9, (4000, 2)), np.zeros(4000)])
    aims[::2, 0], aims[1::2, 1] = rng.uniform(-0.09, 0.09, (2, 2000))
    for origin, first in ((np.array([0, 0, 20.0]), 6.0), (np.array([0, 0, 4.0]), 0.0)):
        aims[:, 2] = first + 0.05 * aims[:, 0]
        way = aims - origin
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        hits = cast_static(world, origin, way, surface=surface)
        places = origin + way * hits.range_m[:, None]
        np.testing.assert_allclose(places, aims, atol=1e-4)
        plain = cast_static(world, origin, way)
        across = aims[:, 1] if first == 0 else aims[:, 0]
        clear = np.abs(np.abs(across) - 0.1) > 0.03
        bright = hits.backscatter > 1.5 * plain.backscatter
        np.testing.assert_array_equal(bright[clear], (np.abs(across) < 0.1)[clear])


def test_only_ground_that_faces_up_takes_paint():
    square = np.array([[[-9, -9], [9, -9], [9, 9], [-9, 9]]], float)
    surface = SurfaceMaterials((layer_of(square),))
    wall = LabelledMesh.build(
        [[-1, 0, -0.5], [1, 0, -0.5], [1, 0, 0.5]], [[0, 1, 2]], semantic_id("road"), 1
    )
    parts = [quad(2, 0.1, "building"), quad(2, 0.0), quad(2, 0.0, "terrain", "grass"), wall]
    world = LabelledMesh.concatenate(parts)
    face = np.arange(len(world.faces))
    found = surface.materials_of(world, face, world.triangles().mean(axis=1))
    asphalt = material_id("asphalt")
    assert found.tolist() == [asphalt, asphalt, PAINT, PAINT, PAINT, PAINT, asphalt]
    upside = LabelledMesh.build(parts[1].vertices, parts[1].faces[:, ::-1], semantic_id("road"), 1)
    assert (surface.materials_of(upside, np.arange(2), np.zeros((2, 3))) == asphalt).all()
    assert (world.material[:2] == asphalt).all()  # the mesh itself is as it was


def test_paint_changes_what_returns_and_nothing_else():
    """A white square on a plain, seen at 1550 nm: worked out from the table."""
    surface = SurfaceMaterials((layer_of(np.array([[[1, -2], [5, -2], [5, 2], [1, 2]]], float)),))
    rng = np.random.default_rng(8)
    aims = np.column_stack([rng.uniform(-10, 10, (3000, 2)), np.zeros(3000)])
    origin = np.array([0.0, 0.0, 3.0])
    way = (aims - origin) / np.linalg.norm(aims - origin, axis=1, keepdims=True)
    plain = cast_static(quad(50, 0.0), origin, way, wavelength_nm=1550.0)
    hits = cast_static(quad(50, 0.0), origin, way, wavelength_nm=1550.0, surface=surface)
    for name in ("range_m", "face", "cosine", "semantic"):
        np.testing.assert_array_equal(getattr(hits, name), getattr(plain, name))
    inside = (aims[:, 0] > 1) & (aims[:, 0] < 5) & (np.abs(aims[:, 1]) < 2)
    paint, asphalt = materials()["road-paint"], materials()["asphalt"]
    numbers = np.where(inside, paint.id, asphalt.id).astype(np.uint8)
    expected = scatter_of_materials(1550.0).backscatter(numbers, -way[:, 2])
    clear = np.abs(aims - [3, 0, 0])[:, :2].max(axis=1)
    np.testing.assert_allclose(
        hits.backscatter[np.abs(clear - 2) > 0.05], expected[np.abs(clear - 2) > 0.05], rtol=1e-5
    )


def test_layers_of_other_sizes_of_cells_work_side_by_side():
    square = np.array([[[-4, -4], [4, -4], [4, 4], [-4, 4]]], float)
    coarse = layer_of_cells(
        cells_of_quads(square, 0.25), material=4, level=0, cell_m=0.25, height=flat()
    )
    assert isinstance(coarse, MaterialLayer)
    both = SurfaceMaterials((layer_of(square / 8), coarse))
    assert both.at([[0.1, 0.1], [2, 2], [3.9, -3.9], [4.1, 0]]).tolist() == [PAINT, 4, 4, 0]
