"""Cleaning a street whose truth is known: what goes, what stays, and the surface left behind."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from urbantwin.geometry import SiteFrame
from urbantwin.reconstruct import PointCloud, TriangleMesh
from urbantwin.reconstruct.cleaning import cleaned, cleaned_cloud
from urbantwin.reconstruct.cleaning.rays import Rays
from urbantwin.site.geometry import CleanSpec, Spot

SLOPE = 0.08
ROAD = shapely.box(-40, -5, 40, 5)
REGION = shapely.box(-38, -14, 38, 14)
CURB_M = 0.15
#: x, y, heading, length, width, height.
CARS = [
    (-30.0, -3.6, 0.0, 4.4, 1.8, 1.5),
    (-22.0, 3.5, 0.05, 4.7, 1.9, 1.45),
    (-13.0, -1.6, -0.2, 4.2, 1.75, 1.5),
    (-4.0, 1.7, 0.0, 5.0, 1.95, 1.9),
    (6.0, -3.7, 0.0, 10.5, 2.5, 3.2),
    (25.0, 1.8, 0.6, 4.4, 1.8, 1.5),
]


def street_height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A plane of 8 %, sidewalks a curb higher; the curb's face leans over 4 cm."""
    return SLOPE * x + CURB_M * np.clip((np.abs(y) - 5.0) / 0.04, 0.0, 1.0)


def lines(start: float, end: float, step: float, extra: tuple[float, ...] = ()) -> np.ndarray:
    return np.unique(np.round(np.concatenate([np.arange(start, end + 1e-9, step), extra]), 6))


def surface(height, x: np.ndarray, y: np.ndarray, name: str = "scan") -> TriangleMesh:
    gx, gy = np.meshgrid(x, y)
    points = np.column_stack([gx.ravel(), gy.ravel(), height(gx, gy).ravel()])
    k = np.arange(gx.size).reshape(gx.shape)
    a, b, c, d = (part.ravel() for part in (k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    colour = np.full((len(faces), 3), 90, np.uint8)
    return TriangleMesh.build(points, faces.astype(np.int32), colour=colour, name=name)


def box(x, y, yaw, length, width, height, *, base=None, name="box", colour=(170, 30, 30)):
    """A box without a bottom, as low models have them, on the street or at a height."""
    u = np.array([-1, 1, 1, -1, -1, 1, 1, -1]) * length / 2
    v = np.array([-1, -1, 1, 1, -1, -1, 1, 1]) * width / 2
    px, py = x + u * np.cos(yaw) - v * np.sin(yaw), y + u * np.sin(yaw) + v * np.cos(yaw)
    ground = street_height(px, py) if base is None else np.full(8, base)
    top = (street_height(np.array(x), np.array(y)) if base is None else base) + height
    points = np.column_stack([px, py, np.where(np.arange(8) < 4, ground, top)])
    faces = [[4, 5, 6], [4, 6, 7]]
    for k in range(4):
        n = (k + 1) % 4
        faces += [[k, n, n + 4], [k, n + 4, k + 4]]
    shade = np.tile(np.array(colour, np.uint8), (len(faces), 1))
    return TriangleMesh.build(points, np.array(faces, np.int32), colour=shade, name=name)


def with_cars(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The street with vehicles melted into it: the flanks fall within a step of the grid."""
    z = street_height(x, y)
    for cx, cy, yaw, length, width, height in CARS:
        u = (x - cx) * np.cos(yaw) + (y - cy) * np.sin(yaw)
        v = -(x - cx) * np.sin(yaw) + (y - cy) * np.cos(yaw)
        inside = (np.abs(u) < length / 2) & (np.abs(v) < width / 2)
        bonnet = (u > 0.25 * length) & (length < 6)
        z = z + np.where(inside, np.where(bonnet, 0.6, 1.0) * height, 0.0)
    return z


def furniture() -> list[TriangleMesh]:
    """What must stay: lamp post, shelter, wall, hedge, bollards, planter, sign, house."""
    out = [box(x, 6.5, 0.0, 0.16, 0.16, 8.0, name="lamp post") for x in (-25.0, 0.0, 25.0)]
    roof = street_height(np.array(12.0), np.array(7.5)) + 2.4
    out.append(box(12.0, 7.5, 0.0, 4.0, 1.5, 0.1, base=float(roof), name="shelter roof"))
    out.append(box(12.0, 8.2, 0.0, 4.0, 0.05, 2.45, name="shelter wall"))
    out.append(box(-8.0, -9.0, 0.0, 12.0, 0.3, 1.2, name="wall"))
    out.append(box(20.0, -9.0, 0.0, 8.0, 1.0, 1.4, name="hedge", colour=(40, 120, 30)))
    out.append(box(16.0, 0.0, 0.0, 6.0, 1.0, 1.2, name="hedge on the median"))
    out += [box(x, 4.6, 0.0, 0.2, 0.2, 1.0, name="bollard") for x in (31.0, 32.5, 34.0)]
    out.append(box(33.0, -1.0, 0.0, 3.0, 1.5, 0.6, name="planter"))
    pole = box(-33.0, 6.0, 0.0, 0.1, 0.1, 3.0, name="sign's pole")
    plate = float(street_height(np.array(-33.0), np.array(6.0))) + 2.2
    out += [pole, box(-33.0, 5.92, 0.0, 0.6, 0.02, 0.6, base=plate, name="sign")]
    out.append(box(-20.0, 11.0, 0.0, 12.0, 5.0, 9.0, name="house"))
    return out


def crown(x: float, y: float) -> TriangleMesh:
    """A tree over the street: a trunk on the sidewalk and a crown of loose leaves that meet."""
    base = float(street_height(np.array(x), np.array(y)))
    generator = np.random.default_rng(3)
    way = generator.normal(0, 1, (400, 3))
    middle = way / np.linalg.norm(way, axis=1, keepdims=True) * 2.2 + [x, y, base + 5.0]
    corner = middle[:, None] + generator.normal(0, 0.25, (400, 3, 3))
    colour = np.tile(np.array([50, 110, 40], np.uint8), (400, 1))
    leaves = TriangleMesh.build(
        corner.reshape(-1, 3), np.arange(1200).reshape(-1, 3).astype(np.int32), colour=colour
    )
    trunk = box(x, y, 0.0, 0.3, 0.3, 3.2, name="trunk", colour=(90, 60, 40))
    return TriangleMesh.concatenate([trunk, leaves])


def shards(count: int = 60) -> TriangleMesh:
    generator = np.random.default_rng(5)
    middle = generator.uniform([-36, -13, 13], [36, 13, 20], (count, 3))
    corner = middle[:, None] + generator.normal(0, 0.4, (count, 3, 3))
    colour = np.full((count, 3), 200, np.uint8)
    return TriangleMesh.build(
        corner.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3).astype(np.int32), colour=colour
    )


X = lines(-42, 42, 0.25)
Y = lines(-16, 16, 0.25, (-5.04, -5.0, 5.0, 5.04))


@pytest.fixture(scope="module")
def scanned():
    """One scanned surface with vehicles in it, furniture, a tree and shards; cleaned."""
    mesh = TriangleMesh.concatenate(
        [surface(with_cars, X, Y), *furniture(), crown(-2.0, -7.0), shards()]
    )
    spec = CleanSpec(chordal_error_m=0.0)
    frame = SiteFrame(48.7, 9.18)
    return mesh, cleaned(mesh, spec, region=REGION, roads=ROAD, frame=frame, name="street")


def vehicles(report):
    return [one for one in report["removed"] if one["what"] not in ("shard", "stray point")]


def test_all_vehicles_are_found_and_nothing_else(scanned) -> None:
    _, result = scanned
    found = np.array([one["at_m"][:2] for one in vehicles(result.report)])
    truth = np.array([car[:2] for car in CARS])
    apart = np.linalg.norm(truth[:, None] - found[None], axis=2)
    assert len(found) == len(truth)
    assert (apart.min(axis=1) < 0.5).all()
    sizes = np.array([one["size_m"] for one in vehicles(result.report)])[apart.argmin(axis=1)]
    np.testing.assert_allclose(sizes, [car[3:] for car in CARS], atol=0.6)
    kinds = np.array([one["what"] for one in vehicles(result.report)])[apart.argmin(axis=1)]
    assert kinds.tolist() == ["car"] * 4 + ["truck or bus", "car"]


def test_the_surface_under_vehicles_is_the_streets(scanned) -> None:
    _, result = scanned
    rays = Rays(result.mesh.vertices, result.mesh.faces)
    for x, y, yaw, length, width, _ in CARS:
        u, v = np.meshgrid(np.linspace(-0.7, 0.7, 41) * length, np.linspace(-0.8, 0.8, 21) * width)
        place = np.column_stack(
            [
                x + (u * np.cos(yaw) - v * np.sin(yaw)).ravel(),
                y + (u * np.sin(yaw) + v * np.cos(yaw)).ravel(),
            ]
        )
        place = place[np.abs(place[:, 1]) < 4.95]
        off = rays.heights(place, 3.0 + SLOPE * x) - street_height(*place.T)
        assert np.abs(off).max() < 0.02


def test_a_ray_down_meets_the_ground_everywhere_and_once(scanned) -> None:
    _, result = scanned
    scan = result.mesh.select(result.mesh.object == 0)
    rays = Rays(scan.vertices, scan.faces)
    generator = np.random.default_rng(1)
    place = generator.uniform([-37.9, -13.9], [37.9, 13.9], (60_000, 2))
    above, below = rays.heights(place, 30.0), rays.heights(place, -30.0, up=True)
    assert np.isfinite(above).all()
    np.testing.assert_allclose(above, below, atol=1e-4)
    # No edge is anyone's alone but those at the region's border.
    sides = np.sort(scan.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, count = np.unique(sides, axis=0, return_counts=True)
    assert count.max() == 2
    alone = scan.vertices[edges[count == 1]]
    middle = shapely.points(alone.mean(axis=1)[:, :2])
    assert shapely.distance(REGION.boundary, middle).max() < 1e-6


def test_everything_else_is_as_it_was(scanned) -> None:
    mesh, result = scanned
    before = {name: number for number, name in enumerate(mesh.names)}
    for name in {one for one in mesh.names if one} - {"scan"}:
        number = before[name]
        old, new = (
            mesh.select(mesh.object == number),
            result.mesh.select(result.mesh.object == number),
        )
        assert len(new.faces) == len(old.faces), name
        np.testing.assert_allclose(
            np.sort(new.triangles().reshape(-1, 9), axis=0),
            np.sort(old.triangles().reshape(-1, 9), axis=0),
            atol=2e-4,
        )


def test_shards_float_and_the_tree_stays(scanned) -> None:
    mesh, result = scanned
    removed = [one for one in result.report["removed"] if one["what"] == "shard"]
    shard_object = len(mesh.names) - 1
    assert not (result.mesh.object == shard_object).any()
    assert len(removed) >= 60 - 5  # some of them overlap
    assert all("floats" in one["why"] for one in removed if one["size_m"][0] > 0.5)
    # The crown's leaves hang together with its trunk, nearly all of them.
    leaves = shard_object - 1
    assert (result.mesh.object == leaves).sum() > 0.9 * 400


def test_the_report_adds_up(scanned) -> None:
    mesh, result = scanned
    report = result.report
    assert report["before"]["triangles"] == len(mesh.faces)
    assert report["after"]["triangles"] == len(result.mesh.faces)
    low, high = np.array(report["after"]["bounds_m"])
    np.testing.assert_allclose([low[0], high[0]], [-38, 38], atol=1e-6)
    frame = SiteFrame(48.7, 9.18)
    for one in vehicles(report):
        place = frame.site_from_lonlat([[one["longitude"], one["latitude"]]])[0]
        np.testing.assert_allclose(place, one["at_m"][:2], atol=0.02)
        assert one["closed_m2"] > 0.9 * one["size_m"][0] * one["size_m"][1] * 0.8
    passed = [one["size_m"] for one in report["not_vehicles"]]
    assert any(abs(size[0] - 6.0) < 0.6 and size[1] < 1.6 for size in passed)  # the hedge


def test_overrides_keep_and_remove() -> None:
    mesh = TriangleMesh.concatenate([surface(with_cars, X, Y), *furniture()])
    spec = CleanSpec(
        chordal_error_m=0.0,
        keep=[Spot(at_m=[-30.0, -3.6], radius_m=2.0), Spot(at_m=[0.0, -12.0], radius_m=0.5)],
        remove=[Spot(at_m=[33.0, -1.0], radius_m=1.0)],
    )
    result = cleaned(mesh, spec, region=REGION, roads=ROAD)
    assert len(vehicles(result.report)) == len(CARS) - 1 + 1
    assert [one["what"] for one in result.report["kept"]] == ["car"]
    names = {mesh.names[k] for k in np.unique(result.mesh.object)}
    assert "planter" not in names
    assert "house" in names
    assert result.report["notes"] == ["nothing to keep within 0.5 m of (0.0, -12.0)"]


def test_steps_can_be_left_out() -> None:
    mesh = TriangleMesh.concatenate([surface(with_cars, X, Y), shards()])
    spec = CleanSpec(shards=False, traffic=False, chordal_error_m=0.0)
    whole = shapely.box(-50, -50, 50, 50)
    result = cleaned(mesh, spec, region=whole, roads=ROAD)
    assert len(result.mesh.faces) == len(mesh.faces)
    assert result.report["removed"] == []


def test_cars_that_stand_on_a_whole_street_are_taken_off_it(shared_data) -> None:
    """A car as its maker drew it, with wheels, glass and seats, on a plane of two triangles."""
    from urbantwin.io.gltf import read_gltf

    folder = shared_data / "meshes" / "openmaterial" / "examples" / "vehicle_example"
    path = folder / "vehicle_example.gltf"
    model = read_gltf(path.read_bytes(), lambda uri: (folder / uri).read_bytes(), name=path.name)
    assert model.mesh is not None
    x, y, z = model.mesh.vertices.T
    car = model.mesh
    placed = [
        TriangleMesh(
            np.column_stack([x + at[0], -z + at[1], y + SLOPE * (x + at[0])]),
            car.faces,
            car.colour,
            car.object,
            car.names,
        )
        for at in [(-10.0, -2.0)]
    ]
    plane = surface(lambda x, y: SLOPE * x, np.array([-42.0, 42.0]), np.array([-16.0, 16.0]))
    mesh = TriangleMesh.concatenate([plane, *placed])
    result = cleaned(mesh, CleanSpec(), region=REGION, roads=ROAD)
    assert [one["what"] for one in vehicles(result.report)] == ["car"]
    np.testing.assert_allclose(vehicles(result.report)[0]["size_m"], [3.85, 1.62, 1.30], atol=0.45)
    assert np.unique(result.mesh.object).tolist() == [0]
    np.testing.assert_allclose(
        result.mesh.vertices[:, 2], SLOPE * result.mesh.vertices[:, 0], atol=1e-6
    )


@pytest.mark.thorough
def test_the_same_comes_out_again() -> None:
    mesh = TriangleMesh.concatenate([surface(with_cars, X[:160], Y), *furniture(), shards(20)])
    spec, sensors = CleanSpec(), [[-30.0, 8.0, 6.0]]
    first, second = (
        cleaned(mesh, spec, region=REGION, roads=ROAD, sensors=sensors) for _ in range(2)
    )
    np.testing.assert_array_equal(first.mesh.vertices, second.mesh.vertices)
    np.testing.assert_array_equal(first.mesh.faces, second.mesh.faces)
    assert first.report == second.report


def test_traffic_and_strays_leave_a_cloud() -> None:
    generator = np.random.default_rng(2)
    place = generator.uniform([-42, -16], [42, 16], (120_000, 2))
    street = np.column_stack([place, with_cars(*place.T)])
    stray = generator.uniform([-30, -10, 15], [30, 10, 40], (25, 3))
    house = np.column_stack(
        [generator.uniform([-26, 9], [-14, 13], (4_000, 2)), np.full(4_000, 8.0)]
    )
    cloud = PointCloud(np.concatenate([street, house, stray]))
    result = cleaned_cloud(cloud, CleanSpec(), region=REGION, roads=ROAD)
    found = np.array([one["at_m"][:2] for one in vehicles(result.report)])
    apart = np.linalg.norm(np.array([car[:2] for car in CARS])[:, None] - found[None], axis=2)
    assert len(found) == len(CARS)
    assert (apart.min(axis=1) < 0.6).all()
    left = result.cloud.points
    over = left[:, 2] - street_height(*left[:, :2].T)
    on_road = np.abs(left[:, 1]) < 4.9
    assert over[on_road].max() < 0.3
    assert sum(one["what"] == "stray point" for one in result.report["removed"]) >= 24
    assert (np.abs(left[:, 2] - 8.0) < 1e-9).sum() > 3_900
    kept_street = (np.abs(over) < 1e-9).sum()
    inside = shapely.contains_xy(REGION, *place.T) & (
        np.abs(with_cars(*place.T) - street_height(*place.T)) < 1e-9
    )
    assert kept_street > 0.999 * inside.sum()
