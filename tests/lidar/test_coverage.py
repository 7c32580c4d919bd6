"""Densities of a rig against closed forms, line of sight by Open3D, and recorded frames."""

import dataclasses
import json

import numpy as np
import open3d as o3d
import pytest

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar.catalogue import sensor
from urbantwin.lidar.placement import place_rig
from urbantwin.lidar.rig import Rig
from urbantwin.lidar.scanner import Scanner
from urbantwin.lidar.sight import LAYERS, rig_coverage
from urbantwin.lidar.sight.cells import cells_over
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

HEIGHT_M = 5.0
BOUNDS = (-60.0, -60.0, 60.0, 60.0)


def rings(model="OS1-128"):
    """Tangents of the angles below the horizon under which the channels look down."""
    down = np.tan(np.radians(-sensor(model).elevation_deg))
    return down[down > 0]


@pytest.fixture(scope="module")
def exact(rig_of, ground_mesh):
    rig = rig_of(ground_mesh(), {"columns": 1024, "effects": False, "yaw_deg": 30.0})
    return rig, rig_coverage(rig, ground_mesh(), BOUNDS)


def of_radius(coverage):
    rows, columns = coverage.cells.shape
    x = BOUNDS[0] + (np.arange(columns) + 0.5) * coverage.cells.size_m
    y = BOUNDS[1] + (np.arange(rows) + 0.5) * coverage.cells.size_m
    return np.hypot(*np.meshgrid(x, y))


def test_every_beam_that_looks_down_is_counted_once(exact):
    _, coverage = exact
    radius = of_radius(coverage)
    for layer, drop in (("ground", HEIGHT_M), ("lying", HEIGHT_M - 1.0)):
        reach = drop / rings()
        count = (coverage.per_frame(layer) * 0.25)[radius < 50].sum()
        near = np.count_nonzero(reach < 50) * 1024
        assert count == pytest.approx(near, abs=1024)  # One ring may lie on the border.


def test_rings_of_the_ground_are_where_the_beams_meet_it(exact):
    _, coverage = exact
    radius = of_radius(coverage)
    met = radius[coverage.per_frame("ground") > 0]
    reach = HEIGHT_M / rings()
    gap = np.abs(met[:, None] - reach[None, :]).min(axis=1)
    assert gap.max() <= 0.5 / np.sqrt(2) + 1e-9


def on_a_wall(model, columns, height_m, near_m, far_m):
    """Points per square metre that faces the beam, from 0.5 to 1.5 m above the ground.

    Around the sensor at radius r, a wall 1 m high meets the beams whose height there is in that
    span; the mean over the area from one radius to the other.
    """
    slopes = np.tan(np.radians(sensor(model).elevation_deg))
    radius = np.linspace(near_m, far_m, 400)
    height = height_m + radius[:, None] * slopes[None, :]
    hits = ((height > 0.5) & (height < 1.5)) * columns
    steep = np.sqrt(1 + slopes**2)[None, :]
    return np.average((hits * steep).sum(axis=1) / (2 * np.pi * radius), weights=radius)


@pytest.mark.parametrize(("near", "far"), [(10, 14), (20, 26), (34, 46)])
def test_a_facing_surface_gets_what_its_rows_of_beams_are(exact, near, far):
    radius = of_radius(exact[1])
    inside = (radius >= near) & (radius < far)
    found = exact[1].per_frame("facing")[inside].mean()
    assert found == pytest.approx(on_a_wall("OS1-128", 1024, HEIGHT_M, near, far), rel=0.01)


def test_level_beams_count_on_facing_surfaces(rig_of, ground_mesh):
    """A sensor 1 m up: its level beams never cross that height, but meet cars all the same."""
    rig = rig_of(ground_mesh(), {"model": "VLP-16", "effects": False, "height_m": 1.0})
    coverage = rig_coverage(rig, ground_mesh(), BOUNDS)
    radius = of_radius(coverage)
    for near, far in ((8, 12), (20, 28)):
        found = coverage.per_frame("facing")[(radius >= near) & (radius < far)].mean()
        expected = on_a_wall("VLP-16", rig.sensors[0].columns, 1.0, near, far)
        assert found == pytest.approx(expected, rel=0.02)


def test_height_is_above_the_ground_on_a_slope(rig_of):
    tilt = np.array([[-80, -80], [80, -80], [80, 80], [-80, 80]], float)
    vertices = np.column_stack([tilt, 0.08 * tilt[:, 0]])
    flat = LabelledMesh.build(vertices, [[0, 1, 2], [0, 2, 3]], 40, 1)
    rig = rig_of(flat, {"columns": 1024, "effects": False})
    coverage = rig_coverage(rig, flat, (-40, -40, 40, 40))
    aims = _beams(rig)
    # Where beams meet the plane one metre above the slope: n . (o + r d) = 1 (cos of the slope).
    normal = np.array([-0.08, 0.0, 1.0])
    range_m = (1.0 - HEIGHT_M) / (aims @ normal)
    places = np.array([0, 0, HEIGHT_M]) + aims * range_m[:, None]
    ahead = (range_m > 0) & (range_m <= rig.sensors[0].sensor.assumed_range_max_m)
    expected, _, _ = np.histogram2d(
        places[ahead, 1], places[ahead, 0], bins=(160, 160), range=((-40, 40), (-40, 40))
    )
    found = coverage.per_frame("lying") * 0.25
    assert expected.sum() > 20_000
    assert np.abs(found - expected).sum() < 0.002 * expected.sum()


def test_what_is_hidden_is_dark(rig_of, street):
    rig = rig_of(street, {"effects": False, "columns": 1024}, {"east_m": 60.0, "effects": False})
    coverage = rig_coverage(rig, street, BOUNDS)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(street.vertices.astype(np.float32), street.faces.astype(np.uint32))
    rows, columns = coverage.cells.shape
    x = BOUNDS[0] + (np.arange(columns) + 0.5) * 0.5
    y = BOUNDS[1] + (np.arange(rows) + 0.5) * 0.5
    # Cells of which no part can be seen: nine places in each, slightly above it.
    for number, mounted in enumerate(rig.sensors):
        origin = mounted.site_SE3_sensor.translation
        hidden = np.ones((rows, columns), bool)
        for dx in (-0.25, 0, 0.25):
            for dy in (-0.25, 0, 0.25):
                east, north = np.meshgrid(x + dx, y + dy)
                for up in (0.02, 1.0, 1.5):
                    target = np.stack([east, north, np.full(east.shape, up)], axis=-1)
                    way = target - origin
                    rays = np.concatenate([np.broadcast_to(origin, way.shape), way], axis=-1)
                    hidden &= scene.test_occlusions(
                        o3d.core.Tensor(rays.astype(np.float32)), 0.0, 0.9999
                    ).numpy()
        assert hidden.sum() > 5000
        for layer in LAYERS:
            density = getattr(coverage, layer)[number]
            assert density[hidden].max() == 0
            assert (density > 0).sum() > 1000


def test_a_pane_of_glass_weakens_and_a_window_of_a_building_hides_as_in_frames(rig_of, ground_mesh):
    """Rooms are not modelled, so no frame has points behind a window of a building."""
    bounds = (20.0, -4.0, 30.0, 4.0)

    def behind(*wall):
        mesh = ground_mesh()
        if wall:
            corners = [(10, -8, 0), (10, 8, 0), (10, 8, 4), (10, -8, 4)]
            semantic, material = semantic_id(wall[0]), material_id(wall[1])
            pane = LabelledMesh.build(corners, [(0, 1, 2), (0, 2, 3)], semantic, material)
            mesh = LabelledMesh.concatenate([mesh, pane])
        rig = rig_of(mesh, {})
        found = rig_coverage(rig, mesh, bounds, cell_m=1.0).per_frame("ground").sum()
        points = Scanner(mesh, rig, 3).scan(0, []).points[:, :3]
        x, y, z = rig.dataset_SE3_site.inverse().apply(points).T
        count = np.count_nonzero((x > 20) & (x < 30) & (np.abs(y) < 4) & (z < 0.5))
        assert count == pytest.approx(found, rel=0.2, abs=5)
        return found

    free, shelter = behind(), behind("other-structure", "glass")
    assert 0.05 * free < shelter < free
    assert behind("building", "glass") == behind("building", "plaster") == 0


def test_turns_that_are_not_recorded_do_not_count(exact, ground_mesh):
    rig, coverage = exact
    one = rig.sensors[0]
    for change, factor in (
        ({"dropped_frames": 0.25}, 0.75),
        ({"turns_per_second": 20.0}, 2.0),
        ({"frame_window_s": 0.05}, 0.5),
    ):
        changed = dataclasses.replace(rig, sensors=(dataclasses.replace(one, **change),))
        found = rig_coverage(changed, ground_mesh(), BOUNDS)
        for layer in LAYERS:
            np.testing.assert_allclose(
                getattr(found, layer), factor * getattr(coverage, layer), rtol=1e-5
            )


def test_the_ground_gets_what_recorded_frames_hold(rig_of, ground_mesh):
    """Drop-out and the law of the ground included: 30 frames of the same sensor."""
    rig = rig_of(ground_mesh(), {"columns": 1024, "model": "OS1-128", "pitch_deg": 3.0})
    coverage = rig_coverage(rig, ground_mesh(), BOUNDS)
    scanner = Scanner(ground_mesh(), rig, 3)
    site_SE3_dataset = rig.dataset_SE3_site.inverse()
    edges = np.array([0, 15, 20, 25, 30, 40, 55.0])
    counts = np.zeros(len(edges) - 1)
    for index in range(30):
        points = site_SE3_dataset.apply(scanner.scan(index, []).points[:, :3])
        counts += np.histogram(np.hypot(points[:, 0], points[:, 1]), edges)[0] / 30
    radius = of_radius(coverage)
    expected = np.histogram(radius, edges, weights=coverage.per_frame("ground") * 0.25)[0]
    np.testing.assert_allclose(counts[:-1], expected[:-1], rtol=0.04, atol=25)
    # Far out bright patches alone return, and few of them lie there.
    assert counts[-1] == pytest.approx(expected[-1], rel=0.35)


def test_a_fine_and_a_coarse_grid_hold_the_same_points(exact, ground_mesh):
    rig, coverage = exact
    coarse = rig_coverage(rig, ground_mesh(), BOUNDS, cell_m=2.0)
    for layer in LAYERS:
        fine = coverage.per_frame(layer).reshape(60, 4, 60, 4).mean(axis=(1, 3))
        np.testing.assert_allclose(coarse.per_frame(layer), fine, rtol=0.02, atol=0.6)


def test_numbers_of_the_streets(exact):
    _, coverage = exact
    summary = coverage.summary()
    assert summary["street_m2"] == 120 * 120
    assert summary["facing"]["m2_from_1"] > summary["facing"]["m2_from_10"] > 100
    assert summary["ground"]["m2_from_2_sensors"] == 0


def test_the_file_holds_the_layers(exact, tmp_path):
    _, coverage = exact
    coverage.save(tmp_path / "a.npz")
    coverage.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as data:
        assert data["sensors"].tolist() == ["s0"]
        np.testing.assert_array_equal(data["lying"], coverage.lying)
        assert float(data["cell_m"]) == 0.5


def test_no_ground_is_a_clear_line(box_mesh, ground_mesh, exact):
    with pytest.raises(InputError, match="no ground"):
        cells_over(box_mesh((0, 0, 0), (1, 1, 1)), BOUNDS, 1.0)
    with pytest.raises(InputError, match="no ground"):
        cells_over(ground_mesh(), (500.0, 0.0, 501.0, 1.0), 0.5)
    for size in (0.0, -1.0, float("nan"), float("inf"), 1e-12):
        with pytest.raises(InputError, match="cell"):
            cells_over(ground_mesh(), BOUNDS, size)
    rig: Rig = exact[0]
    riding = dataclasses.replace(rig.sensors[0], carrier_SE3_sensor=Pose.from_ypr(np.zeros(3)))
    with pytest.raises(InputError, match="mounted on a vehicle"):
        rig_coverage(dataclasses.replace(rig, sensors=(riding,)), ground_mesh(), BOUNDS)


def _beams(rig):
    from urbantwin.lidar.pattern import beam_directions

    one = rig.sensors[0]
    return beam_directions(one.sensor, one.columns).reshape(-1, 3) @ one.site_SE3_sensor.rotation.T


def test_a_sector_that_fails_is_dark(rig_of, ground_mesh):
    rig = rig_of(ground_mesh(), {"effects": False, "outages": [{"sector_deg": [0, 90]}]})
    coverage = rig_coverage(rig, ground_mesh(), BOUNDS)
    for layer in LAYERS:
        density = coverage.per_frame(layer)
        rows, columns = np.nonzero(density)
        x, y = BOUNDS[0] + columns * 0.5, BOUNDS[1] + rows * 0.5  # The cell's south-west corner.
        assert not ((x > 0) & (y > 0)).any()
        assert len(x) > 5000


def test_a_pattern_counts_all_its_period(tmp_path, ground_mesh):
    time_s = np.arange(4000) / 20_000
    way = np.column_stack([time_s, -10 + 500 * time_s % 20, -30 + 100 * time_s])
    header = "time_s,azimuth_deg,elevation_deg"
    np.savetxt(tmp_path / "scan.csv", way, delimiter=",", header=header, comments="")
    unknown = dict.fromkeys(
        "reference_reflectivity reference_range_m range_sigma_m range_resolution_m "
        "wavelength_nm".split()
    )
    model = {"name": "Scan", "maker": "me", "pattern": "scan.csv", "points_per_second": 20_000}
    model |= {"range_min_m": 0.5, "range_max_m": 100, **unknown}
    (tmp_path / "scan.yaml").write_text(json.dumps(model))
    place = {"name": "one", "model": "scan.yaml", "east_m": 0, "north_m": 0, "height_m": 5}
    spec = RigSpec.model_validate({"rate_hz": 10, "sensors": [{**place, "effects": False}]})
    rig = place_rig(spec, ground_mesh(), file=tmp_path / "rig.yaml")
    coverage = rig_coverage(rig, ground_mesh(), BOUNDS)
    # It looks down all the time, from 30 to 10 degrees: every one of its points is on the ground.
    assert coverage.ground.sum() * 0.25 == pytest.approx(20_000, rel=1e-4)
