"""A sensor's pose found from one frame: of made streets whose rays Open3D casts, and a real one."""

import json
from dataclasses import replace

import numpy as np
import pytest
import shapely
import yaml

from urbantwin.artefact import overwriting, sha256_of, write_json
from urbantwin.cli import main
from urbantwin.errors import InputError
from urbantwin.fidelity.alignment import (
    Guess,
    align,
    aligned_poses,
    ground_plane,
    write_aligned_rig,
)
from urbantwin.fidelity.alignment.align import least_evidence
from urbantwin.fidelity.alignment.curbs import above_lowest, curbs_of
from urbantwin.fidelity.alignment.frame_features import FrameFeatures, posts_of
from urbantwin.fidelity.alignment.ground_plane import leveling
from urbantwin.fidelity.alignment.lane_markings import bright_spots_of, mark_lines
from urbantwin.fidelity.alignment.pose_belief import beliefs
from urbantwin.fidelity.alignment.pose_search import PoseSearch
from urbantwin.fidelity.alignment.registration import sandwich
from urbantwin.fidelity.alignment.rig_alignment import averaged
from urbantwin.fidelity.alignment.road_edges import road_edges
from urbantwin.fidelity.alignment.scene_points import ScenePoints
from urbantwin.fidelity.alignment.search_span import SearchSpan
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, MaterialLayer, Pose, SurfaceMaterials
from urbantwin.geometry.surface_material import TILE
from urbantwin.lidar import place_rig
from urbantwin.site import load_site
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.twin import build_twin

from ..real_cases.argoverse_log import Log
from ..real_cases.pittsburgh_site import Place, write_site
from ..real_files import argoverse_log
from ..thorough import further


def box(middle, size, name):
    x, y, z = np.array([-1, 1]) / 2 * np.array(size)[:, None] + np.array(middle)[:, None]
    corners = np.array([[a, b, c] for a in x for b in y for c in z])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))]
    return LabelledMesh.build(corners, faces, semantic_id(name), material_id("concrete"))


def slope(reach=80.0, east=0.03, north=-0.02):
    xy = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * reach
    corners = np.column_stack([xy, xy @ [east, north]])
    return LabelledMesh.build(
        corners, [[0, 1, 2], [0, 2, 3]], semantic_id("road"), material_id("asphalt")
    )


def street():
    """A sloping street with houses of several sizes and poles, none placed evenly."""
    houses = [((-18, 14, 5), (14, 9, 14)), ((9, 19, 4), (17, 8, 12)), ((21, -15, 6), (11, 13, 16))]
    houses += [((-14, -19, 3), (19, 7, 10)), ((33, 9, 4), (6, 12, 12))]
    poles = [((5, 8, 3), (0.3, 0.3, 9)), ((-7, -9, 3), (0.3, 0.3, 9)), ((13, -6, 3), (0.4, 0.4, 9))]
    parts = [box(*one, "building") for one in houses] + [box(*one, "pole") for one in poles]
    return LabelledMesh.concatenate([slope(), *parts])


def seen(mesh, pose, noise_m=0.02, step_deg=1.0):
    """What 48 beams see from a pose, in the sensor's frame; Open3D casts the rays."""
    o3d = pytest.importorskip("open3d")
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.faces.astype(np.uint32)),
    )
    elevation, azimuth = np.meshgrid(
        np.radians(np.linspace(-30, 12, 48)), np.radians(np.arange(0, 360, step_deg)), indexing="ij"
    )
    aim = np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth)]
        + [np.sin(elevation)],
        axis=-1,
    ).reshape(-1, 3)
    start = np.broadcast_to(pose.translation, aim.shape)
    rays = np.hstack([start, aim @ pose.rotation.T]).astype(np.float32)
    away = scene.cast_rays(o3d.core.Tensor(rays))["t_hit"].numpy().astype(float)
    away += np.random.default_rng(5).normal(0, noise_m, len(away))
    hit = np.isfinite(away) & (away < 70)
    return aim[hit] * away[hit, None]


def off(found, true):
    turned = found.rotation.T @ true.rotation
    angle = np.degrees(np.arccos(np.clip((np.trace(turned) - 1) / 2, -1, 1)))
    return np.linalg.norm(found.translation - true.translation), angle


#: On a pole, tipped and leaning; 5 m above the ground there.
TRUE = Pose.from_ypr([2.0, -3.0, 5.12], *np.radians([63.0, 12.0, -4.0]))


@pytest.fixture(scope="module")
def points():
    return seen(street(), TRUE)


def test_the_ground_of_a_frame_tells_height_and_tilt(points):
    plane = ground_plane(points)
    up = np.array([-0.03, 0.02, 1.0]) / np.linalg.norm([-0.03, 0.02, 1.0])
    assert np.degrees(np.arccos(plane.normal @ (TRUE.rotation.T @ up))) < 0.3
    assert plane.height_m == pytest.approx(5.0 * up[2], abs=0.03)


def test_ground_that_begins_far_away_is_ground():
    """The lowest beams of an OS2, 11 degrees down, meet it 31 m from a pole of 6 m."""
    down, around = np.meshgrid(np.radians(np.linspace(7, 11, 20)), np.radians(np.arange(360)))
    far = 6.0 / np.tan(down.ravel())
    spots = [far * np.cos(around.ravel()), far * np.sin(around.ravel()), np.full(len(far), -6.0)]
    plane = ground_plane(np.column_stack(spots))
    assert plane.height_m == pytest.approx(6.0)
    assert plane.normal == pytest.approx([0, 0, 1])


@pytest.fixture(scope="module")
def found(points):
    """The tipped sensor, from no guess."""
    return align(Frame(points), street(), region=shapely.box(-1.0, -5.0, 4.0, 0.0))


def test_a_tipped_sensor_is_found_from_no_guess(found):
    away, angle = off(found.pose, TRUE)
    assert away < 0.03
    assert angle < 0.1
    assert found.confidence > 0.4
    assert found.found.residual_m < 0.03


@pytest.fixture
def twin_of_street(tmp_path):
    """The street as a twin: its mesh alone."""
    folder = tmp_path / "twin"
    folder.mkdir()
    street().save(folder / "scene.npz")
    (folder / "site.yaml").write_text("traffic:\n  seed: 0\n")
    sensor = {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 4}
    (folder / "rig.yaml").write_text(yaml.safe_dump({"sensors": [sensor]}))
    write_json(
        folder / "twin.json",
        {
            **{"kind": "twin", "version": "test", "name": "street", "driving_side": "right"},
            **{"notes": {}, "anchor": {"latitude": 48.7, "longitude": 9.18}, "inputs": []},
            "region_m": [[-60, -60], [60, -60], [60, 60], [-60, 60]],
            "files": {"scene.npz": sha256_of(folder / "scene.npz")},
        },
    )
    return folder


@pytest.mark.thorough
def test_a_tipped_sensor_is_found_from_a_rough_guess_by_the_command(
    points, twin_of_street, tmp_path, capsys
):
    (tmp_path / "frames").mkdir()
    bare = np.column_stack([points, np.zeros(len(points))])
    np.save(tmp_path / "frames" / "0.npy", bare.astype(np.float32))
    found, told = by_the_command(
        tmp_path / "frames", twin_of_street, (3.6, -4.3, 74.0), tmp_path / "found", capsys
    )
    away, angle = off(found, TRUE)
    assert away < 0.03
    assert angle < 0.1
    assert np.linalg.norm(told["sigma_m"]) < 0.1


def by_the_command(frames, twin, guess, folder, capsys):
    """The pose in the rig that is written, and what is told."""
    out = folder / "rig.yaml"
    arguments = ["rig", "align", frames, twin, "--guess", *guess, "-o", out, "--json"]
    assert main([str(one) for one in arguments]) == 0
    told = json.loads(capsys.readouterr().out)
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    sensor = yaml.safe_load(out.read_text())["sensors"][0]
    place = [sensor[name] for name in ("east_m", "north_m", "up_m")]
    angles = [sensor[name] for name in ("yaw_deg", "pitch_deg", "roll_deg")]
    return Pose.from_ypr(place, *np.radians(angles)), told


@pytest.mark.thorough
def test_standing_proud_of_what_is_there_moves_no_sensor(points):
    """Every house and pole 0.3 m too wide in the twin, as outlines with eaves are."""
    narrow, wide = street(), street()
    for part in (5, 6, 7):  # only one side of the street has something near
        corners = slice(4 + 8 * part, 12 + 8 * part)
        middle = wide.vertices[corners].mean(axis=0)
        wide.vertices[corners, :2] += 0.3 * np.sign(narrow.vertices[corners] - middle)[:, :2]
    for part in range(5):
        corners = slice(4 + 8 * part, 12 + 8 * part)
        middle = wide.vertices[corners].mean(axis=0)
        wide.vertices[corners, :2] += 0.3 * np.sign(narrow.vertices[corners] - middle)[:, :2]
    found = align(Frame(points), wide, guess=Guess(3.6, -4.3, 74.0))
    assert off(found.pose, TRUE)[0] < 0.05
    assert found.found.surface_offset_m == pytest.approx(-0.3, abs=0.05)


def test_a_bare_plane_holds_no_place():
    with pytest.raises(InputError):
        align(Frame(seen(slope(), TRUE)), slope(), guess=Guess(3.0, -3.5, 70.0))


def test_the_scatter_of_poses_is_that_of_the_errors_over_the_curvature_that_is_left():
    """Least squares of which each error pulls as the matrix says, and half of it pulls back."""
    generator = np.random.default_rng(3)
    root = generator.normal(size=(8, 8)) + 3 * np.eye(8)
    matrix = root @ root.T
    pulls = generator.multivariate_normal(np.zeros(8), matrix, 40_000)
    for left in (0.5, 1.0):
        poses = np.linalg.solve(left * matrix, pulls.T).T
        assert sandwich(matrix, left * matrix) == pytest.approx(poses.var(axis=0)[:6], rel=0.05)
    # A curvature that was measured larger than it can be makes nothing surer.
    assert sandwich(matrix, 3.0 * matrix) == pytest.approx(np.diag(np.linalg.inv(matrix))[:6])


@pytest.mark.thorough
def test_two_places_that_look_alike_are_said():
    twice = street()
    twice = LabelledMesh.concatenate([twice.select(twice.semantic != semantic_id("road"))] * 2)
    copy = slice(len(twice.vertices) // 2, None)
    shift = np.array([70.0, 0.0])
    twice.vertices[copy] += [*shift, shift @ [0.03, -0.02]]
    world = LabelledMesh.concatenate([slope(reach=120.0), twice])
    with pytest.raises(InputError, match="two places 70"):
        align(
            Frame(seen(world, TRUE)),
            world,
            guess=Guess(37.0, -3.0, 63.0, within_m=37.0, within_deg=4.0),
        )


def test_a_place_beside_the_right_one_is_no_second_one(points):
    """What is likely around both is counted once, and told of the nearer."""
    plane = ground_plane(points)
    span = SearchSpan(TRUE.translation[:2], 3.0, np.radians(63.0), np.radians(15.0))
    scene = ScenePoints(street(), span.middle, 50.0)
    search = PoseSearch(scene, FrameFeatures.of(Frame(points), np.zeros(3), plane), plane, span)
    yaw = np.arctan2(*(TRUE.rotation @ leveling(plane.normal).T[:, 0])[1::-1])
    told = beliefs(search, [(span.middle, yaw), (span.middle + [0.3, 0.0], yaw)], span)
    assert told[0].share > 0.95
    assert sum(one.share for one in told) == pytest.approx(1.0)


def test_what_is_no_frame_of_a_street_is_said(points):
    with pytest.raises(InputError, match="points within"):
        align(Frame(points[:50]), street())
    with pytest.raises(InputError, match="no ground"):
        align(Frame(points * [1, 1, -1]), street())
    with pytest.raises(InputError, match="no ground"):
        align(Frame(points), street(), guess=Guess(500.0, 0.0, 0.0))


def test_the_rest_of_a_rig_moves_with_its_first_sensor_and_its_file_stays(tmp_path):
    text = {
        "rate_hz": 5,
        "sensors": [
            {"name": "a", "model": "VLP-16", "east_m": 0, "north_m": 0, "height_m": 4}
            | {"heading_deg": 90, "effects": {"noise": False}},
            {"name": "b", "model": "VLP-16", "east_m": 1, "north_m": 0, "up_m": 4.2},
        ],
    }
    file = tmp_path / "rig.yaml"
    file.write_text(yaml.safe_dump(text))
    before = place_rig(RigSpec.model_validate(text), street())
    with pytest.raises(InputError, match="--overwrite"):
        write_aligned_rig(file, file, aligned_poses(before, TRUE))
    with overwriting(True):
        write_aligned_rig(file, file, aligned_poses(before, TRUE))
    written = yaml.safe_load(file.read_text())
    assert written["rate_hz"] == 5
    assert written["sensors"][0]["effects"] == {"noise": False}
    after = place_rig(RigSpec.model_validate(written), street())
    first, second = (one.site_SE3_sensor for one in after.sensors)
    assert off(first, TRUE) == pytest.approx((0, 0), abs=2e-4)
    apart = [
        a.inverse() @ b for a, b in ((first, second), [s.site_SE3_sensor for s in before.sensors])
    ]
    assert off(*apart) == pytest.approx((0, 0), abs=5e-4)


def kerbed(half=5.0, kerb=0.14, reach=60.0):
    """Two crossing streets with kerbs and nothing else: carriageway 10 m wide, sidewalks higher."""
    quads = [([-reach, -half], [reach, half]), ([-half, half], [half, reach])]
    quads += [([-half, -reach], [half, -half])]
    parts = []
    for low, high in quads:
        (x0, y0), (x1, y1) = low, high
        corners = [[x0, y0, 0], [x1, y0, 0], [x1, y1, 0], [x0, y1, 0]]
        parts.append(flat(corners, "road"))
    for sx in (-1, 1):
        for sy in (-1, 1):
            x, y = np.array([half, reach]) * sx, np.array([half, reach]) * sy
            top = [[x[0], y[0], kerb], [x[1], y[0], kerb], [x[1], y[1], kerb], [x[0], y[1], kerb]]
            parts.append(flat(top, "sidewalk"))
            for ends in ([(x[0], y[0]), (x[1], y[0])], [(x[0], y[0]), (x[0], y[1])]):
                face = [[*ends[0], 0], [*ends[1], 0], [*ends[1], kerb], [*ends[0], kerb]]
                parts.append(flat(face, "sidewalk"))
    return LabelledMesh.concatenate(parts)


def flat(corners, name):
    corners = np.array(corners, float)
    up = np.cross(corners[1] - corners[0], corners[2] - corners[0])[2]
    faces = [[0, 1, 2], [0, 2, 3]] if up >= 0 else [[0, 2, 1], [0, 3, 2]]
    return LabelledMesh.build(corners, faces, semantic_id(name), material_id("asphalt"))


#: On a car's roof, in the crossing.
ON_CAR = Pose.from_ypr([1.5, -1.2, 1.9], *np.radians([20.0, 1.0, -0.5]))


def test_curbs_are_found_where_they_are():
    seen_there = seen(kerbed(), ON_CAR, noise_m=0.005)
    curbs = curbs_of(seen_there, ON_CAR.rotation.T @ [0.0, 0.0, 1.0])
    at = ON_CAR.apply(curbs.points)
    x, y = np.abs(at[:, :2]).T
    # Sidewalks fill the four corners from 5 m on: beyond it, and before it.
    outside = np.hypot(np.maximum(5.0 - x, 0.0), np.maximum(5.0 - y, 0.0))
    away = np.where((x > 5.0) & (y > 5.0), np.minimum(x, y) - 5.0, outside)
    assert len(at) >= 12
    assert np.median(away) < 0.05
    assert (away < 0.2).mean() > 0.8
    road = curbs.road @ ON_CAR.rotation.T
    inward = ((at + 0.5 * road)[:, :2] ** 2).min(axis=1) < 25.0
    assert inward.mean() > 0.8


def test_road_edges_are_where_carriageway_meets_other_ground():
    edges, normal = road_edges(kerbed().select(kerbed().normals()[:, 2] > 0.1))
    x, y = np.abs(edges[:, :2]).T
    assert np.abs(np.minimum(x, y) - 5.0).max() < 1e-9
    assert np.ptp(edges[:, 0]) > 110  # along the whole street, but not across where it ends
    inside = np.abs((edges + normal)[:, :2])
    assert (inside.min(axis=1) < 5.0).all()


@pytest.mark.thorough
def test_a_crossing_is_held_by_its_curbs_alone():
    """In the twin the sidewalks lie level with the road, as where a DEM smooths over them."""
    level = kerbed(kerb=0.0)
    guess = Guess(ON_CAR.translation[0] + 0.9, ON_CAR.translation[1] - 0.8, 27.0, within_deg=12.0)
    dense = seen(kerbed(), ON_CAR, noise_m=0.01, step_deg=0.5)
    found = align(Frame(dense), level, guess=guess)
    apart = found.pose.translation - ON_CAR.translation
    assert np.hypot(*apart[:2]) < 0.04  # up is between the two heights of its ground
    assert off(found.pose, ON_CAR)[1] < 0.2
    assert found.found.curbs_explained > 0.3
    assert found.found.sigma_m[:2].max() < 0.1


def test_painted_lines_are_found_in_the_twin_and_bright_spots_in_the_frame():
    cell = 0.05
    inside = np.zeros((TILE, TILE), bool)
    inside[20:23] = True  # a line of 15 cm from west to east, and a patch that is none
    inside[40:60, 10:40] = True
    layer = MaterialLayer(
        material_id("road-paint"), 0, cell, np.zeros((1, 2), np.int32),
        np.packbits(inside, axis=1)[None], np.zeros((1, 2, 2), np.float32),
    )  # fmt: skip
    places, across = mark_lines(SurfaceMaterials((layer,)), np.zeros(2), 10.0)
    assert len(places) > 10
    assert np.allclose(places[:, 1], 21.5 * cell, atol=2e-3)
    assert np.allclose(np.abs(across[:, 1]), 1.0, atol=1e-3)

    generator = np.random.default_rng(2)
    road = np.column_stack([generator.uniform(-5, 5, (9000, 2)), np.zeros(9000)])
    on_line = np.abs(road[:, 1] - 1.0) < 0.075
    for scale in (1.0, 255.0):
        shine = scale * (0.1 + 0.01 * generator.normal(size=9000) + 0.1 * on_line)
        spots = bright_spots_of(road, road, shine)
        near = np.abs(spots.points[:, 1] - 1.0) < 0.075
        assert spots.weight[near].sum() > 0.9 * spots.weight.sum()
        assert near.sum() > 0.8 * on_line.sum()
    assert not len(bright_spots_of(road, road, np.full(9000, 7.0)).points)


@pytest.fixture(scope="module")
def pittsburgh(shared_data, tmp_path_factory):
    """The twin that the log's vector map and heights give, the log, and the vehicle's pose."""
    log = Log(shared_data / "lidar" / "argoverse2-pittsburgh")
    folder = tmp_path_factory.mktemp("pittsburgh")
    site = load_site(write_site(log, folder, 45))
    twin = build_twin(site, folder / "twin")
    return log, twin, Place.of(log, log.sweeps[0], twin).site_SE3_vehicle


@pytest.mark.thorough
def test_the_real_sensors_of_argoverse_are_found_from_2_m_and_10_degrees_off(
    pittsburgh, tmp_path, capsys
):
    """By the command; ground and lanes are all that the twin has."""
    log, twin, true = pittsburgh
    yaw = np.degrees(np.arctan2(true.rotation[1, 0], true.rotation[0, 0]))
    start = [true.translation[0] + 1.6, true.translation[1] + 1.2, yaw + 10.0]
    found, told = by_the_command(log.folder, twin.folder, start, tmp_path / "found", capsys)
    away, angle = off(found, true)
    assert away < 0.10
    assert angle < 0.5
    assert away / 3 < np.linalg.norm(told["sigma_m"]) < 0.2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--frames", "0,7"], "no frame 7"),
        (["--frames", "first"], "frames are"),
        (["--sensor", "roof"], "no sensor 'roof'"),
        (["--guess", "900", "0", "0"], "no ground"),
    ],
)
def test_what_cannot_be_aligned_is_said_in_one_line_and_nothing_written(
    shared_data, twin_of_street, tmp_path, capsys, arguments, said
):
    log = argoverse_log(shared_data)
    out = tmp_path / "found" / "rig.yaml"
    assert main(["rig", "align", str(log), str(twin_of_street), "-o", str(out), *arguments]) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "align:" not in line[:7]]
    assert len(lines) == 1
    assert said in lines[0]
    assert not out.parent.exists()


@pytest.mark.parametrize(("off_m", "within_m"), [*further((0.998, 1.0)), (1.6, 1.0)])
def test_a_span_bounds_the_pose_and_holds_to_its_very_edge(points, off_m, within_m):
    guess = Guess(2.0 - off_m, -3.0, 63.0, within_m, within_deg=5.0)
    if off_m > within_m:
        with pytest.raises(InputError, match=r"fits best 1\.6\d m"):
            align(Frame(points), street(), guess=guess)
        return
    found = align(Frame(points), street(), guess=guess).pose
    assert off(found, TRUE)[0] < 0.03
    assert found.translation[0] - guess.east_m <= within_m + 1e-9


@pytest.mark.thorough
def test_a_street_that_repeats_is_not_believed_where_a_guess_leaves_out_the_right_place(points):
    """Everything stands there once more 4 m on; the truth lies 1 m beyond the span."""
    here = street()
    again = here.select(here.semantic != semantic_id("road"))
    again.vertices[:] += [4.0, 0.0, 4.0 * 0.03]  # the ground rises
    again.part[:] += 100
    world = LabelledMesh.concatenate([here, again])
    with pytest.raises(InputError, match=r"just beyond the guess, 4\.\d m from where it fits"):
        align(Frame(points), world, guess=Guess(6.0, -3.0, 63.0, within_m=3.0, within_deg=8.0))


@pytest.mark.thorough
def test_poles_alone_hold_a_place_and_those_of_elsewhere_do_not():
    """Houses stand in the street that the map has not; its ground is bare."""
    places = np.array([[5, 8], [-7, -9], [13, -6], [-3, 11], [9, -13], [-12, 2], [16, 4], [2, -16]])
    poles, elsewhere = (
        [
            replace(box((x, y, 3), (0.3, 0.3, 9), "pole"), part=np.full(12, number + 1))
            for number, (x, y) in enumerate(some)
        ]
        for some in (places, places[:, ::-1] * [-1, 1] + [3, 1])
    )
    frame = Frame(seen(LabelledMesh.concatenate([street(), *poles]), TRUE))
    guess = Guess(1.2, -3.9, 70.0, within_m=2.0, within_deg=10.0)
    found = align(frame, LabelledMesh.concatenate([slope(), *poles]), guess=guess)
    assert off(found.pose, TRUE)[0] < 0.1
    assert (np.abs(found.pose.translation - TRUE.translation) < 2 * found.found.sigma_m).all()
    with pytest.raises(InputError):
        align(frame, LabelledMesh.concatenate([slope(), *elsewhere]), guess=guess)


def at_posts(places, high_m=7.0, wide_m=0.25):
    """Posts that stand on the sloping street."""
    return [
        replace(
            box((x, y, 0.03 * x - 0.02 * y + high_m / 2), (wide_m, wide_m, high_m), "pole"),
            part=np.full(12, number + 1),
        )
        for number, (x, y) in enumerate(places)
    ]


def test_posts_of_a_frame_are_found_behind_cars_and_walls_are_none():
    posts = np.array([[6.0, 4.0], [-8.0, 5.0], [14.0, -11.0]])
    things = [
        box((5.2, 1.8, 0.8), (4.4, 1.8, 1.5), "car"),  # hides the foot of the first
        box((2.0, 12.0, 3.0), (22.0, 0.3, 6.0), "building"),
        box((-5.0, -8.0, 0.5), (0.5, 0.4, 1.8), "pedestrian"),
        box((-12.0, -9.0, 4.0), (5.0, 5.0, 3.0), "vegetation"),
        box((9.0, -14.0, 1.0), (3.0, 0.6, 2.0), "vegetation"),
    ]
    world = LabelledMesh.concatenate([slope(), *things, *at_posts(posts)])
    points = seen(world, TRUE, step_deg=0.4)
    level = points @ leveling(ground_plane(points).normal).T
    found = posts_of(level, above_lowest(level))
    at = TRUE.apply(found.axis @ leveling(ground_plane(points).normal))[:, :2]
    away = np.hypot(*(at[:, None] - posts).transpose(2, 0, 1))
    assert at.shape == (3, 2)
    assert (away.min(axis=0) < 0.1).all()
    mine = found.of >= 0
    near = np.hypot(*(TRUE.apply(points[mine])[:, None, :2] - posts).transpose(2, 0, 1)).min(axis=1)
    assert mine.sum() > 30
    assert near.max() < 0.4


def test_a_low_post_far_off_is_found_and_one_beside_a_wall_is_none():
    up = np.arange(0.35, 1.75, 0.1)
    free, beside = ([[x, y, z - 2.0] for z in up] for x, y in ((45.0, 3.0), (20.0, -5.0)))
    wall = [[20.0 + x, -5.5, z - 2.0] for x in np.arange(-2.0, 2.0, 0.1) for z in up]
    level = np.array([*free, *beside, *wall])
    found = posts_of(level, level[:, 2] + 2.0)
    np.testing.assert_allclose(found.axis[:, :2], [[45.0, 3.0]], atol=0.05)


@pytest.mark.thorough
def test_narrow_spans_need_less_evidence_and_posts_of_elsewhere_have_not_even_that():
    """In 0.5 m and 2 degrees 3 x 3 places half a metre apart differ, and 2 to 3 headings."""
    spans = [SearchSpan(np.zeros(2), m, 0.0, np.radians(deg)) for m, deg in ((0.5, 2), (3, 15))]
    narrow, usual = (least_evidence(span) for span in spans)
    assert np.log(9 * 2) + 1.9 < narrow < np.log(9 * 3) + 2.1
    assert usual == least_evidence(SearchSpan(np.zeros(2), 100.0, 0.0, np.pi)) == 8.0
    places = np.array([[6.0, 4.0], [-8.0, 5.0], [14.0, -11.0], [-3.0, -14.0]])
    frame = Frame(seen(LabelledMesh.concatenate([street(), *at_posts(places)]), TRUE, step_deg=0.5))
    east, north = TRUE.translation[:2] + [0.2, -0.3]
    yaw = float(np.degrees(np.arctan2(TRUE.rotation[1, 0], TRUE.rotation[0, 0]))) + 1.0
    guess = Guess(float(east), float(north), yaw, within_m=0.5, within_deg=2.0)
    map_ = LabelledMesh.concatenate([slope(), *at_posts(places[:3] + 0.1)])
    assert align(frame, map_, guess=guess).evidence > narrow
    for seed in range(3):
        others = np.random.default_rng(seed).uniform(-15, 15, (5, 2))
        with pytest.raises(InputError, match=r"three posts|guess"):
            align(frame, LabelledMesh.concatenate([slope(), *at_posts(others)]), guess=guess)


@pytest.mark.thorough
def test_three_posts_hold_a_place_and_one_does_not():
    """In a street of which the map has nothing else, and a post that is not there."""
    places = np.array([[6.0, 4.0], [-8.0, 5.0], [14.0, -11.0], [-3.0, -14.0]])
    frame = Frame(seen(LabelledMesh.concatenate([street(), *at_posts(places)]), TRUE, step_deg=0.8))
    guess = Guess(1.0, -4.2, 68.0, within_m=2.0, within_deg=10.0)
    moved = places + [[0.1, 0.05], [-0.1, 0.1], [0.0, -0.1], [0.1, 0.0]]
    map_ = LabelledMesh.concatenate([slope(), *at_posts([*moved, [-9.0, 13.0]])])
    found = align(frame, map_, guess=guess)
    assert found.found.posts == 4
    assert off(found.pose, TRUE)[0] < 0.15
    assert (np.abs(found.pose.translation - TRUE.translation) < 2 * found.found.sigma_m).all()
    for some in (moved[:1], places[:, ::-1] * [-1, 1] + [3, 1]):
        with pytest.raises(InputError, match=r"three posts|another guess|nearer to the right one"):
            align(frame, LabelledMesh.concatenate([slope(), *at_posts(some)]), guess=guess)


@pytest.mark.thorough
def test_a_bare_plane_is_nowhere_in_pittsburgh(pittsburgh):
    """Though the twin's ground has relief, on which it would come to rest somewhere."""
    _, twin, _ = pittsburgh
    places = np.random.default_rng(0).uniform(-30, 30, (20_000, 2))
    plane = Frame(np.column_stack([places, np.full(len(places), -2.0)]))
    with pytest.raises(InputError, match="nothing but ground"):
        align(plane, twin.mesh, guess=Guess(1.0, 1.0, -23.0))


def test_frames_of_one_place_are_averaged_and_those_of_two_are_not(found):
    one = found
    beside = Pose(one.pose.rotation, one.pose.translation + [0.02, 0.0, 0.0])
    mean = averaged([one, replace(one, pose=beside)])
    assert mean.pose.translation == pytest.approx(one.pose.translation + [0.01, 0.0, 0.0])
    assert mean.frames == 2
    assert mean.scatter_m == pytest.approx(0.01)
    assert (mean.found.sigma_m >= one.found.sigma_m).all()
    away = Pose(one.pose.rotation, one.pose.translation + [1.2, 0.0, 0.0])
    with pytest.raises(InputError, match=r"places 1\.20 m"):
        averaged([one, replace(one, pose=away)])
