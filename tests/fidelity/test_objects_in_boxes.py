"""Bodies in real boxes: rays found again, boxes mended, figures of known scenes."""

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import urbantwin as ut
from objects_in_boxes.bodies import PlacedBody, candidates, placed
from objects_in_boxes.figures import figures_of
from objects_in_boxes.frame_rays import rays_of
from objects_in_boxes.measure import compare_objects
from objects_in_boxes.mending import PassedBy, mended, mended_of
from objects_in_boxes.scan_rays import scan_rays
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar import MountedSensor, PosedActor, Rig, Scanner, sensor
from urbantwin.site.rig import Effects
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic.assets import asset, scaled_mesh

from ..real_files import argoverse_log

pytestmark = pytest.mark.thorough


def ring_frame(kept: np.ndarray, rings: bool) -> tuple[Frame, np.ndarray]:
    """A frame of 16 rings of 900 firings on a sphere, those of ``kept``; and all directions."""
    turn = np.radians(0.4 * np.arange(900) + 0.1)
    up = np.radians(np.linspace(10, -20, 16))
    aims = np.stack(
        [
            np.cos(up)[:, None] * np.cos(turn),
            np.cos(up)[:, None] * np.sin(turn),
            np.broadcast_to(np.sin(up)[:, None], (16, 900)),
        ],
        axis=-1,
    )
    ring = np.broadcast_to(np.arange(16)[:, None], kept.shape)[kept]
    return Frame(20 * aims[kept], ring=ring if rings else None, name="made"), aims


@pytest.mark.parametrize("rings", [True, False])
def test_rays_without_a_return_are_found_between_those_with_one(rings: bool) -> None:
    kept = np.random.default_rng(5).random((16, 900)) > 0.2
    frame, aims = ring_frame(kept, rings)
    (rays,) = rays_of(frame)
    lost = rays.direction[rays.point < 0]
    assert len(lost) == (~kept).sum()
    apart = np.arccos(np.clip((lost @ aims[~kept].T).max(axis=1), -1, 1))
    assert apart.max() < np.radians(0.02)
    back = rays.point[rays.before] >= 0
    assert back.all()
    assert (rays.point[rays.after] >= 0).all()


def test_points_in_no_order_without_rings_are_refused() -> None:
    points = np.random.default_rng(1).normal(0, 20, (3000, 3))
    with pytest.raises(ut.InputError, match="has no rings"):
        rays_of(Frame(points, name="mixed"))


def test_a_slack_box_is_mended_to_the_points() -> None:
    true = np.array([10.0, 4.0, 0.75, 4.4, 1.8, 1.5, 0.3])
    body = placed("car", true, 0)
    surface = surface_of(body, count=4000)
    slack = true + [0.1, -0.06, 0.03, 0.25, 0.1, 0.06, 0.02]
    x, y, z = (float(one) for one in slack[3:6] / true[3:6])
    drawn = replace(body, box=slack, mesh=scaled_mesh(body.mesh, (x, y, z)))
    found = mended(drawn, surface).box
    before, after = np.abs(slack - true), np.abs(found - true)
    assert after[:2].max() < 0.5 * before[:2].max()
    assert (after[3:6] < 0.6 * before[3:6] + 0.01).all()


def surface_of(body: PlacedBody, seed: int = 2, count: int = 1500) -> np.ndarray:
    """Return points (N, 3) on the surface of a body where it stands."""
    draw = np.random.default_rng(seed)
    area = body.mesh.areas()
    corners = body.mesh.triangles()[draw.choice(len(area), count, p=area / area.sum())]
    weight = draw.dirichlet(np.ones(3), len(corners))
    return np.asarray(body.pose.apply((corners * weight[:, :, None]).sum(axis=1)))


def test_beams_at_edges_are_of_what_most_of_them_meets() -> None:
    # Somebody 20 m away, before the sky or 1 m before a wall: where half of a beam meets him or
    # less, the wall is brighter; alone he gets beams that only touch him, too.
    (body, *_) = candidates("pedestrian", np.array([20.0, 0, 0.9, 0.6, 0.6, 1.8, 0]), 0)
    corners = np.array([[-60.0, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]])
    ground = LabelledMesh.build(
        corners, np.array([[0, 1, 2], [0, 2, 3]]), semantic_id("road"), material_id("asphalt")
    )
    turn, up = np.meshgrid(
        np.radians(np.arange(-1.5, 1.5, 0.2)), np.radians(np.arange(-3.5, 1, 0.02))
    )
    aims = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1)
    aims = aims.reshape(-1, 3)
    place, model = np.array([0.0, 0, 1.6]), sensor("VLP-32C")
    meets, counts = [], []
    for behind_m in (np.inf, 21.0):
        behind = np.full(len(aims), behind_m) / aims[:, 0]
        seen = scan_rays(model, place, aims, [body], ground, behind, 1)
        meets.append((seen.body == 0).sum())
        counts.append((seen.reported == 0).sum())
    assert meets[0] == meets[1] > 300
    alone, before_wall = np.array(counts) / meets[0]
    # A few per cent of beams are lost on cloth. 3.1 mrad add 3.4 cm on either side at 20 m, a
    # seventh of somebody's width.
    assert before_wall == pytest.approx(0.96, abs=0.04)
    assert alone / before_wall == pytest.approx(1.15, abs=0.06)


def test_rays_that_passed_over_a_roof_mend_its_height() -> None:
    """Points of doors alone do not say how high a car is; what was seen behind it does."""
    true = np.array([10.0, 0.0, 0.75, 4.4, 1.8, 1.5, np.pi / 2])
    body = placed("car", true, 0)
    outside = replace(body, mesh=body.mesh.select(body.outer))
    points = surface_of(outside, count=4000)
    points = points[(points[:, 2] < 0.6) & (points[:, 0] < true[0])][:60]
    slack = true.copy()
    slack[5] += 0.15
    slack[2] += 0.075
    drawn = replace(body, box=slack, mesh=scaled_mesh(body.mesh, (1.0, 1.0, 1.1)))
    origin = np.array([0.0, 0.0, 1.9])
    side, up = np.meshgrid(np.linspace(-0.3, 0.3, 61), np.arange(1.0, 2.2, 0.01))
    target = np.column_stack([np.full(side.size, 10.0), 10.0 * side.ravel(), up.ravel()])
    aim = (target - origin) / np.linalg.norm(target - origin, axis=1)[:, None]
    local = body.pose.inverse()
    scene = RayScene(body.mesh.vertices, body.mesh.faces)
    met = scene.cast(local.apply(origin[None])[0], (aim @ local.rotation.T).astype(np.float32))
    range_m = np.where(met.face < 0, 40.0, met.range_m)
    passed = PassedBy.of(slack, origin, aim, range_m)
    assert 100 < len(passed.start) < (met.face < 0).sum()
    without, found = mended(drawn, points), mended(drawn, points, passed)
    assert abs(found.box[5] - true[5]) < 0.04
    assert abs(without.box[5] - true[5]) > 2 * abs(found.box[5] - true[5])
    assert len(PassedBy.of(slack, origin, aim, np.full(len(aim), np.inf)).start) == 0


def test_what_stands_behind_panes_is_no_outer_surface() -> None:
    body = placed("car", np.array([0.0, 0.0, 0.75, 4.4, 1.8, 1.5, 0.0]), 0)
    middle, material = body.mesh.triangles().mean(axis=1), body.mesh.material
    assert body.outer[material == material_id("glass-tinted")].mean() > 0.8
    assert not body.outer[material == material_id("cloth")].any()  # seats
    roof = (middle[:, 2] > 1.45) & (np.abs(middle[:, 1]) < 0.4)
    assert body.outer[roof & (body.mesh.normals()[:, 2] > 0.5)].all()


def test_a_box_that_is_far_off_is_found_and_its_body_told() -> None:
    """22 cm aside: hardly a point lies near the body's surface at first."""
    true = np.array([10.0, 4.0, 0.75, 4.9, 1.87, 1.47, 0.3])
    estate = next(
        one for one in candidates("car", true, 0) if one.asset.startswith("car-estate-large")
    )
    aside = 0.22 * np.array([-np.sin(0.3), np.cos(0.3)])
    slack = true.copy()
    slack[:2] += aside
    found = mended_of(candidates("car", slack, 0), surface_of(estate))
    assert found.asset == estate.asset
    assert np.linalg.norm(found.box[:2] - true[:2]) < 0.05


def test_people_keep_their_proportions_and_get_the_posture_of_the_points() -> None:
    box = np.array([6.0, -3.0, 0.9, 0.9, 0.9, 1.8, 1.0])
    tried = candidates("pedestrian", box, 3)
    for body in tried:
        assert np.ptp(body.mesh.vertices[:, 2]) == pytest.approx(1.8, rel=1e-3)
        assert np.ptp(body.mesh.vertices[:, 1]) < 0.8
        assert not body.asset.startswith(("pedestrian-stroller", "pedestrian-wheelchair"))
    true = tried[-1]
    found = mended_of(tried, surface_of(true))
    assert found.asset == true.asset
    assert found.mesh.vertices.shape == true.mesh.vertices.shape
    assert np.abs(found.mesh.vertices - true.mesh.vertices).max() < 0.08
    pushed = candidates("pedestrian", np.array([0, 0, 0.83, 1.7, 0.56, 1.66, 0]), 3, "STROLLER")
    assert pushed[0].asset.startswith("pedestrian-stroller")


@cache
def made_frame() -> Frame:
    """Four actors, in the coats that are drawn for them, on a plane as an OS1-64 scans them."""
    ground = LabelledMesh.build(
        [[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("road"),
        material_id("asphalt"),
    )
    effects = Effects(rolling_shutter=False, blooming=False)
    mount = Pose.from_ypr(np.array([0, 0, 2.0]))
    one = MountedSensor("roof", sensor("OS1-64"), 1024, mount, effects)
    placed_at = {
        "car-sedan_grey": (8.0, 3.0, 0.4),
        "car-minivan_black": (-12.0, 5.0, 2.0),
        "truck-rigid-26t_black": (4.0, -14.0, -0.7),
        "pedestrian-backpack": (6.0, -3.0, 1.0),
    }
    actors = []
    for number, (name, (x, y, yaw)) in enumerate(placed_at.items(), 1):
        body = asset(name)
        pose = Pose.from_ypr(np.array([x, y, 0.0]), yaw)
        actors.append(PosedActor(number, body.actor_class, name, body.standing, pose, np.zeros(3)))
    rig = Rig((one,), "site", 10.0, Pose.from_ypr(np.zeros(3)))
    scanned = Scanner(ground, rig, 3).scan(0, actors)
    labels = sorted(scanned.boxes, key=lambda label: label.track)
    return Frame(
        scanned.points[:, :3].astype(np.float64),
        intensity=scanned.points[:, 3].astype(np.float64),
        ring=scanned.ring.astype(np.int64),
        boxes=Boxes(
            np.array([label.box for label in labels]),
            tuple(label.actor_class for label in labels),
            np.array([label.track for label in labels]),
        ),
        sensor_places=np.array([[0.0, 0.0, 2.0]]),
        name="made",
    )


def test_a_frame_of_ours_is_like_itself() -> None:
    """What the scanner made of whole turns comes out again along the rays that are found."""
    frame = made_frame()
    seen = compare_objects(frame, sensor("OS1-64"), scale=1.0)
    assert [one.class_name for one in seen] == ["car", "car", "truck", "pedestrian"]
    for one in seen:
        assert one.counts["mended"] == pytest.approx(one.counts["real"], rel=0.12), one.class_name
        assert one.chamfer_m["annotated"] is not None
        assert one.chamfer_m["annotated"] < 0.1, one.class_name
    rows = {row["class"]: row for row in figures_of(seen) if row["to_m"] == 80}
    lost = rows["car"]["lost_opaque"]
    # Other draws decide which of these rays are lost: three standard errors of a difference.
    share = (lost["real"] + lost["ours"]) / 200
    assert abs(lost["real"] - lost["ours"]) < 300 * (2 * share * (1 - share) / lost["rays"]) ** 0.5
    assert rows["truck"]["code_zero"]["ours"] == pytest.approx(
        rows["truck"]["code_zero"]["real"], abs=1.5
    )


def test_who_moves_is_met_where_each_sensor_saw_it() -> None:
    """A car at 10 m/s, scanned by one sensor and half a turn later by another."""
    effects = Effects(rolling_shutter=False, blooming=False)
    ground = LabelledMesh.build(
        [[-90, -90, 0], [90, -90, 0], [90, 90, 0], [-90, 90, 0]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("road"),
        material_id("asphalt"),
    )
    velocity, body = np.array([6.0, 8.0, 0.0]), asset("car-sedan_grey")
    heading, points, rings, boxes, places = np.arctan2(8.0, 6.0), [], [], [], []
    for turn, height in enumerate((2.0, 1.6)):
        place = np.array([7.0, 3.0, 0.0]) + 0.05 * turn * velocity
        actor = PosedActor(
            1, "car", "car-sedan_grey", body.standing, Pose.from_ypr(place, heading), np.zeros(3)
        )
        mount = Pose.from_ypr(np.array([0, 0, height]))
        one = MountedSensor("roof", sensor("OS1-64"), 1024, mount, effects)
        rig = Rig((one,), "site", 10.0, Pose.from_ypr(np.zeros(3)))
        scanned = Scanner(ground, rig, 3).scan(0, [actor])
        points.append(scanned.points[:, :3].astype(np.float64))
        rings.append(scanned.ring.astype(np.int64))
        boxes.append(scanned.boxes[0].box)
        places.append(mount.translation)
    sensor_of = np.repeat([0, 1], [len(one) for one in points])
    box = np.mean(boxes, axis=0)[None]
    frame = Frame(
        np.concatenate(points),
        ring=np.concatenate(rings),
        time_s=0.02 + 0.05 * sensor_of,
        sensor=sensor_of,
        boxes=Boxes(box, ("car",), np.array([1]), velocity=velocity[None]),
        sensor_places=np.array(places),
        name="made",
    )
    (right,) = compare_objects(frame, sensor("OS1-64"), scale=None)
    still = replace(frame.boxes, velocity=None)
    (wrong,) = compare_objects(replace(frame, boxes=still), sensor("OS1-64"), scale=None)
    assert right.counts["real"] > wrong.counts["real"] > 100  # some lie outside of the box
    there, off = right.chamfer_m["both"], wrong.chamfer_m["both"]
    assert there is not None
    assert off is not None
    assert there < 0.04
    assert off > 1.5 * there
    assert right.counts["mended"] == pytest.approx(right.counts["real"], rel=0.1)


def test_a_body_that_is_not_there_changes_the_figures() -> None:
    """Boxes in the wrong places are told from those in the right ones."""
    frame = made_frame()
    assert frame.boxes is not None
    cars = [Boxes(frame.boxes.box[:2].copy(), ("car", "car"), np.array([1, 2])) for _ in range(2)]
    cars[1].box[:, 6] += np.pi / 2
    right, other = (
        compare_objects(replace(frame, boxes=one), sensor("OS1-64"), scale=1.0) for one in cars
    )
    for there, off in zip(right, other, strict=True):
        assert there.chamfer_m["annotated"] is not None
        away = off.chamfer_m["annotated"]
        assert away is None or away > 3 * there.chamfer_m["annotated"]


@pytest.mark.real
def test_real_cars_and_people(shared_data: Path, tmp_path: Path) -> None:
    log = argoverse_log(shared_data)
    _, *later = sorted(path.name for path in (log / "sensors/lidar").iterdir())
    first = shutil.copytree(log, tmp_path / "log", ignore=shutil.ignore_patterns(*later))
    assert len(later) == 1
    seen = compare_objects(open_recording(first).read(0), sensor("VLP-32C"), scale=255.0)
    rows = {(row["class"], row["from_m"], row["to_m"]): row for row in figures_of(seen)}
    cars = rows["car", 0.0, 80.0]
    assert cars["boxes"] >= 15
    assert 0.8 < cars["points_ratio"] < 1.25
    # The first box of a car is mended, or it is left as it was: it never gets worse in the mean.
    assert cars["chamfer_m"] < cars["chamfer_annotated_m"] < 0.35
    assert rows["pedestrian", 0.0, 80.0]["chamfer_m"] < 0.2
