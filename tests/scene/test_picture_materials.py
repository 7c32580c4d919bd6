"""Materials told by pictures, against pictures drawn of a known street."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.roads import Lane, RoadNetwork
from urbantwin.scene.ground_material import ground_materials
from urbantwin.scene.ground_material.picture import picture_materials
from urbantwin.site import Orthophoto
from urbantwin.taxonomy import material_id, semantic_id

HALF, TURN = 40.0, np.radians(12.0)
#: Share of the light that comes back, red, green, blue: grey values of materials as pictures show.
ALBEDO = {
    "asphalt": (0.115, 0.113, 0.110),
    "asphalt-dark": (0.068, 0.067, 0.066),
    "asphalt-light": (0.190, 0.185, 0.180),
    "road-paint": (0.550, 0.550, 0.530),
    "yellow": (0.500, 0.380, 0.080),
    "grass": (0.055, 0.085, 0.030),
    "soil": (0.180, 0.125, 0.075),
    "concrete": (0.300, 0.290, 0.270),
    "paving": (0.240, 0.225, 0.200),
}
CARS = [
    (-12, -1.7, (0.75, 0.75, 0.75)),
    (12, -4.9, (0.02, 0.02, 0.025)),
    (14, 1.7, (0.35, 0.03, 0.03)),
    (-8, 5.0, (0.50, 0.50, 0.52)),
    (24, 4.9, (0.70, 0.70, 0.68)),
    (-28, -5, (0.05, 0.07, 0.20)),
]


@dataclass
class Drawn:
    """A picture and what is on it, (n, n) each."""

    photo: Orthophoto
    truth: NDArray[np.uint8]
    paint_share: NDArray[np.float64]
    shadow: NDArray[np.bool_]
    cars: NDArray[np.bool_]


def along_street(x, y):
    """Metres along a street through the middle, and to its left."""
    c, s = np.cos(TURN), np.sin(TURN)
    return x * c + y * s, y * c - x * s


def street_materials(u, v):
    """What lies where: a street of 14 m with a zebra, between sidewalks, soil, grass, concrete."""
    road, names = np.abs(v) < 7, list(ALBEDO)
    code = np.full(u.shape, names.index("grass"), np.uint8)

    def put(name, where):
        code[where] = names.index(name)

    put("soil", v > 12)
    put("concrete", v < -14)
    put("paving", (np.abs(v) >= 7) & (np.abs(v) < 10))
    put("asphalt", road | ((u > 20) & (v < -14)))
    put("asphalt-dark", road & (u > 18) & (u < 32) & (v < 0))
    put("asphalt-light", road & (u < -22) & (u > -34))
    put("yellow", (np.abs(v) < 0.35) & (np.abs(v) > 0.2))
    put("road-paint", np.abs(np.abs(v) - 6.5) < 0.075)
    put("road-paint", (np.abs(np.abs(v) - 3.3) < 0.075) & (u % 9 < 3))
    put("road-paint", (np.abs(u) < 2) & (v % 1.0 < 0.5) & (np.abs(v) < 6))
    put("road-paint", (np.abs(u - 4) < 0.2) & (v < 0) & (v > -6.4))
    return code


@cache
def draw(
    cell_m,
    *,
    seed=0,
    tint=(1.0, 0.95, 0.85),
    gain=1.6,
    noise=0.06,
    marks=True,
    sky=(0.27, 0.30, 0.375),
):
    """Draw the street: texture, cars, shadows in the sky's blue light, blur, noise, 8 bits."""
    rng, names, fine = np.random.default_rng(seed), list(ALBEDO), 3
    n = int(2 * HALF / cell_m)
    at = (np.arange(n * fine) + 0.5) * cell_m / fine - HALF
    x, y = np.meshgrid(at, at)
    u, v = along_street(x, y)
    code = street_materials(u, v)
    if not marks:
        code[np.isin(code, [names.index("road-paint"), names.index("yellow")])] = 0
    albedo = np.array(list(ALBEDO.values()))[code]

    def rough(size, depth):
        return 1 + gaussian_filter(rng.normal(size=(n, n)), size) * depth

    def finer(values):
        return values.repeat(fine, 0).repeat(fine, 1)[..., None]

    albedo = albedo * finer(rough(3, 6 * noise))
    grass = (code == names.index("grass"))[..., None]
    albedo = np.where(grass, albedo * finer(rough(1.5, 0.5)), albedo)
    cars = np.zeros(u.shape, bool)
    for ahead, left, colour in CARS:
        body = (np.abs(u - ahead) < 2.2) & (np.abs(v - left) < 0.9)
        albedo[body] = colour
        panes = (np.abs(np.abs(u - ahead) - 0.9) < 0.3) & (np.abs(v - left) < 0.75)
        albedo[panes] = (0.02, 0.025, 0.03)
        cars |= body
    across = x + 0.6 * y
    shadow = ((across > 16) & (across < 30) & (y > -30)) | ((x - 20) ** 2 + (y + 9) ** 2 < 20)
    light = np.where(shadow[..., None], sky, 1.0)
    seen = (albedo * light).reshape(n, fine, n, fine, 3).mean(axis=(1, 3)) * tint * gain
    seen = gaussian_filter(seen, (0.45, 0.45, 0))
    seen = (
        seen * (1 + rng.normal(size=(n, n, 1)) * noise * 0.7) + rng.normal(size=seen.shape) * 3e-3
    )
    seen = np.clip(seen, 0, 1)
    byte = np.where(
        seen <= 0.0031308, 12.92 * seen, 1.055 * np.maximum(seen, 1e-9) ** (1 / 2.4) - 0.055
    )
    number = [material_id("road-paint" if name == "yellow" else name) for name in names]

    def coarse(values):
        return values.reshape(n, fine, n, fine)

    truth = np.array(number, np.uint8)[code]
    rgb = np.rint(byte * 255).astype(np.uint8)
    return Drawn(
        Orthophoto(-HALF, -HALF, cell_m, rgb, np.ones((n, n), bool), cell_m, ()),
        coarse(truth)[:, 1, :, 1],
        coarse(truth == material_id("road-paint")).mean(axis=(1, 3)),
        coarse(shadow).mean(axis=(1, 3)) > 0.5,
        coarse(cars).mean(axis=(1, 3)) > 0,
    )


def strip(left, right, semantic, material, z=0.0, span=80.0):
    corners = np.array([[-span, right], [span, right], [span, left], [-span, left]])
    c, s = np.cos(TURN), np.sin(TURN)
    xy = np.column_stack([corners @ [c, -s], corners @ [s, c]])
    vertices = np.column_stack([xy, np.full(4, z)])
    return LabelledMesh.build(
        vertices, [[0, 1, 2], [0, 2, 3]], semantic_id(semantic), material_id(material)
    )


def street_mesh():
    return LabelledMesh.concatenate(
        [
            strip(7, -7, "road", "asphalt"),
            strip(10, 7, "sidewalk", "paving"),
            strip(-7, -10, "sidewalk", "paving"),
            strip(60, 10, "terrain", "soil"),
            strip(-10, -60, "terrain", "soil"),
        ]
    )


def level(xy, _=0):
    return np.zeros(len(xy))


def middles(photo):
    n = len(photo.known)
    x, y = np.meshgrid(*[(np.arange(n) + 0.5) * photo.cell_m - HALF] * 2)
    return np.column_stack([x.ravel(), y.ravel()])


def told(drawn, mesh=None, modelled=None):
    """What a beam from above would meet, (n, n), and the picture's notes."""
    mesh = street_mesh() if mesh is None else mesh
    some = modelled or (lambda points: np.arange(len(points)) % 14 == 0)  # about as much paint
    found = picture_materials(drawn.photo, mesh, (0,), level, some)
    points = middles(drawn.photo)
    lifted = np.column_stack([points, np.zeros(len(points))])
    # The strips lie side by side: the face under a point is told by its distance to the street.
    _, v = along_street(*points.T)
    face = 2 * np.select(
        [np.abs(v) <= 7, (v > 7) & (v <= 10), (v < -7) & (v >= -10), v > 10], [0, 1, 2, 3], 4
    )
    got = SurfaceMaterials(found.layers).materials_of(mesh, face, lifted)
    return got.reshape(drawn.truth.shape), found


@pytest.fixture(scope="module")
def at_10_cm():
    drawn = draw(0.1)
    return drawn, told(drawn)[0]


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("asphalt", 0.95),
        ("asphalt-dark", 0.75),
        ("asphalt-light", 0.85),
        ("concrete", 0.95),
        ("paving", 0.95),
        ("grass", 0.95),
        ("soil", 0.95),
        ("road-paint", 0.85),
    ],
)
def test_materials_in_the_sun_are_told(at_10_cm, name, least):
    drawn, got = at_10_cm
    there = (drawn.truth == material_id(name)) & ~drawn.shadow & ~drawn.cars
    assert there.sum() > 1000
    assert (got[there] == material_id(name)).mean() > least


@pytest.mark.parametrize(("name", "least"), [("grass", 0.95), ("soil", 0.95), ("road-paint", 0.8)])
def test_colours_and_paint_are_told_in_the_shade(at_10_cm, name, least):
    drawn, got = at_10_cm
    there = (drawn.truth == material_id(name)) & drawn.shadow & ~drawn.cars
    assert there.sum() > 500
    assert (got[there] == material_id(name)).mean() > least


def test_shade_makes_no_other_asphalt_of_a_road(at_10_cm):
    drawn, got = at_10_cm
    _, v = along_street(*middles(drawn.photo).T)
    road = (np.abs(v) < 6.9).reshape(got.shape) & drawn.shadow & ~drawn.cars
    plain = road & (drawn.truth == material_id("asphalt"))
    assert (got[plain] == material_id("asphalt")).mean() > 0.95


def test_a_grey_shadow_is_told_by_the_ground_beside_the_road():
    """Without the sky's blue a shadow looks like dark asphalt, but lies on sidewalks as well."""
    drawn = draw(0.2, sky=(0.3, 0.3, 0.3))
    got, _ = told(drawn)
    _, v = along_street(*middles(drawn.photo).T)
    half = ((v > 0.5) & (v < 6.4)).reshape(got.shape)  # the other one has asphalt that is dark
    plain = half & (drawn.truth == material_id("asphalt")) & ~drawn.cars
    assert (got[plain & drawn.shadow] == material_id("asphalt-dark")).mean() < 0.1
    assert (got[plain & ~drawn.shadow] == material_id("asphalt")).mean() > 0.9


@pytest.mark.parametrize("dark", [25, 45, 70])
def test_new_asphalt_is_dark_however_dark_it_is(dark):
    """Flat colours: a street of two asphalts between grass and pale sidewalks."""
    n, cell_m = 400, 0.2
    x, y = np.meshgrid(*[(np.arange(n) + 0.5) * cell_m - HALF] * 2)
    u, v = along_street(x, y)
    rgb = np.full((n, n, 3), (70, 110, 50), np.uint8)
    rgb[np.abs(v) < 10] = (185, 180, 172)
    rgb[np.abs(v) < 7] = (105, 104, 103)
    rgb[(np.abs(v) < 7) & (u > 15)] = dark
    rgb[(np.abs(v) < 7) & (u < -20)] = (160, 158, 155)
    photo = Orthophoto(-HALF, -HALF, cell_m, rgb, np.ones((n, n), bool), cell_m, ())
    found = picture_materials(photo, street_mesh(), (0,), level, lambda points: points[:, 0] > 1e9)
    at = SurfaceMaterials(found.layers).at
    middle = np.column_stack([x.ravel(), y.ravel()])
    inner = (np.abs(v) < 6).ravel()
    u = u.ravel()
    assert (at(middle[inner & (u > 16)]) == material_id("asphalt-dark")).mean() > 0.98
    assert (at(middle[inner & (u < -21)]) == material_id("asphalt-light")).mean() > 0.98
    assert (at(middle[inner & (np.abs(u) < 14)]) == 0).mean() > 0.98


def test_what_is_taken_for_paint_is_paint_or_next_to_it(at_10_cm):
    drawn, got = at_10_cm
    paint = got == material_id("road-paint")
    near = gaussian_filter(drawn.paint_share, 1.0) > 0.02
    assert (paint & near).sum() / paint.sum() > 0.97
    # White, grey, black, red and blue cars: 48 m2 of them.
    assert (paint & drawn.cars).sum() < 0.05 * drawn.cars.sum()
    assert not (
        paint & (np.abs(along_street(*middles(drawn.photo).T)[1]).reshape(paint.shape) > 7.2)
    ).any()


@pytest.mark.parametrize("cell_m", [0.1, 0.2])
def test_a_painted_line_lands_within_half_a_pixel(cell_m):
    """The solid lines along the street: their middles from one end to the other."""
    drawn = draw(cell_m)
    got, _ = told(drawn)
    u, v = along_street(*middles(drawn.photo).T)
    paint = (got == material_id("road-paint")).ravel()
    for line in (-6.5, 6.5):
        for first in range(-36, 16, 4):  # 4 m at a time, where the sun shines
            here = paint & (np.abs(v - line) < 0.35) & (u >= first) & (u < first + 4)
            here &= ~drawn.shadow.ravel() & ~drawn.cars.ravel()
            if here.sum() > 10:
                assert abs(v[here].mean() - line) < cell_m / 2


@pytest.mark.parametrize(
    "look", [{"tint": (0.8, 0.95, 1.1), "gain": 0.7}, {"gain": 2.2, "noise": 0.1}], ids=str
)
def test_the_cameras_taste_does_not_matter(look):
    drawn = draw(0.2, seed=5, **look)
    got, _ = told(drawn)
    for name, least in (("asphalt", 0.9), ("grass", 0.9), ("soil", 0.9), ("road-paint", 0.75)):
        there = (drawn.truth == material_id(name)) & ~drawn.shadow & ~drawn.cars
        assert (got[there] == material_id(name)).mean() > least, name


def test_what_stands_on_the_ground_is_not_taken_for_it():
    """A roof over half of the street, as the picture shows it: nothing is told under it."""
    roof = strip(30, -30, "building", "roofing", z=8.0, span=20.0)
    drawn = draw(0.2)
    found = picture_materials(
        drawn.photo, LabelledMesh.concatenate([street_mesh(), roof]), (0,), level,
        lambda points: np.arange(len(points)) % 14 == 0,
    )  # fmt: skip
    points = middles(drawn.photo)
    u, v = along_street(*points.T)
    under = (np.abs(u) < 20) & (np.abs(v) < 30)
    assert (SurfaceMaterials(found.layers).at(points[under]) == 0).all()
    assert not found.shows(points[under]).any()
    assert found.shows(points[(np.abs(v) < 6) & (np.abs(u) > 22) & (np.abs(u) < 30)]).mean() > 0.7


def zebra_street():
    """The street with one crossing at u = 10, away from what the picture shows at u = 0."""
    c, s = np.cos(TURN), np.sin(TURN)

    def place(u, v):
        return [u * c - v * s, u * s + v * c, 0.0]

    none = np.zeros((0, 2))
    road = Lane("r", "e", "driving", 14.0, 14.0, np.array([place(-80, 0), place(80, 0)]), none, 0,
                ("car",), (), "")  # fmt: skip
    way = Lane("c", "", "crossing", 4.0, 1.4, np.array([place(10, -6), place(10, 6)]), none, 0,
               ("pedestrian",), (), "")  # fmt: skip
    return RoadNetwork("right", (), (road, way), (), (), ())


def crossing_share(surface, where, drawn):
    """Share of a crossing of 4 by 12 m that is painted."""
    points = middles(drawn.photo)
    u, v = along_street(*points.T)
    there = (np.abs(u - where) < 2) & (np.abs(v) < 6)
    return (surface.at(points[there]) == material_id("road-paint")).mean()


def test_the_pictures_paint_replaces_the_lane_models_where_it_is_clear():
    drawn, region = draw(0.1), shapely.box(-HALF, -HALF, HALF, HALF)
    plain = ground_materials(None, zebra_street(), region, level)
    assert crossing_share(plain.surface, 10.0, drawn) == pytest.approx(0.5, abs=0.05)
    assert crossing_share(plain.surface, 0.0, drawn) == 0.0
    tree = strip(8, 0, "vegetation", "foliage", z=5.0, span=20.0)
    mesh = LabelledMesh.concatenate([street_mesh(), tree])
    both = ground_materials(None, zebra_street(), region, level, mesh=mesh, photo=drawn.photo)
    assert both.notes["paint"] == "of the picture where it is clear"
    # The southern half of the street is open to the sky, the other is under leaves.
    assert 0.15 < crossing_share(both.surface, 0.0, drawn) < 0.3
    assert 0.2 < crossing_share(both.surface, 10.0, drawn) < 0.32
    points = middles(drawn.photo)
    u, v = along_street(*points.T)
    open_sky = (np.abs(u - 10) < 2) & (v < -0.8) & (np.abs(v) < 2.8)
    assert (both.surface.at(points[open_sky]) == material_id("road-paint")).mean() < 0.1


@pytest.mark.parametrize(
    ("photo", "why"),
    [
        (lambda: draw(0.2, marks=False).photo, "times as much"),
        (lambda: draw(0.4).photo, "too coarse"),
    ],
    ids=["worn", "coarse"],
)
def test_a_picture_that_shows_no_paint_leaves_the_lane_models(photo, why):
    region = shapely.box(-HALF, -HALF, HALF, HALF)
    drawn = draw(0.2)
    found = ground_materials(None, zebra_street(), region, level, mesh=street_mesh(), photo=photo())
    assert why in found.notes["paint"]
    assert crossing_share(found.surface, 10.0, drawn) == pytest.approx(0.5, abs=0.05)
    _, v = along_street(*middles(drawn.photo).T)
    lawn = (np.abs(v) < 11.5) & (np.abs(v) > 10.5)
    grass = found.surface.at(middles(drawn.photo)[lawn]) == material_id("grass")
    assert grass.mean() > 0.8
