"""Boxes, points and cells of several nodes put together: by formulas, and by statistics."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)

from urbantwin.detections import DETECTED_CLASSES  # noqa: E402
from urbantwin.fidelity.frame import Frame  # noqa: E402
from urbantwin.geometry import Pose, points_in_box  # noqa: E402
from urbantwin.learn.detecting import found_in  # noqa: E402
from urbantwin.learn.model import Design, Model, new_network  # noqa: E402
from urbantwin.studies.fusion.box_fusion import (  # noqa: E402
    covariance_intersection,
    fused_boxes,
    kalman_update,
    matched_boxes,
)
from urbantwin.studies.fusion.boxes import (  # noqa: E402
    Boxes,
    advanced_boxes,
    advanced_points,
    moving_of,
    places_before,
)
from urbantwin.studies.fusion.channel import Channel, latest  # noqa: E402
from urbantwin.studies.fusion.feature_maps import (  # noqa: E402
    chosen_cells,
    detected_in_cells,
    encoded,
    merged,
    warped,
)
from urbantwin.studies.fusion.nodes import Look, Node  # noqa: E402

CAR, PERSON = DETECTED_CLASSES.index("car"), DETECTED_CLASSES.index("pedestrian")
Floats = NDArray[np.float64]


def spreads(count: int, size: int, seed: int) -> Floats:
    root = np.random.default_rng(seed).normal(0, 1, (count, size, size))
    return np.asarray(root @ root.transpose(0, 2, 1) + 0.1 * np.eye(size))


def test_the_intersection_is_the_formulas_and_its_share_the_best() -> None:
    draw = np.random.default_rng(3)
    a, b = draw.normal(0, 2, (2, 20, 4))
    spread_a, spread_b = spreads(20, 4, 1), spreads(20, 4, 2)
    told, spread = covariance_intersection(a, spread_a, b, spread_b)
    for row in range(20):
        best = np.inf
        for w in np.linspace(0, 1, 101):
            know = w * np.linalg.inv(spread_a[row]) + (1 - w) * np.linalg.inv(spread_b[row])
            if np.linalg.det(np.linalg.inv(know)) < best * (1 - 1e-9):
                best = np.linalg.det(np.linalg.inv(know))
                mean = np.linalg.solve(
                    know,
                    w * np.linalg.solve(spread_a[row], a[row])
                    + (1 - w) * np.linalg.solve(spread_b[row], b[row]),
                )
        assert np.linalg.det(spread[row]) == pytest.approx(best, rel=1e-6)
        assert np.allclose(told[row], mean, atol=1e-6)


@pytest.mark.parametrize("common", [0.0, 0.5, 0.95])
def test_the_intersection_is_never_too_sure_and_the_update_is(common: float) -> None:
    # Two estimates of 0 whose errors have a share in common: what they err by in truth.
    draw = np.random.default_rng(4)
    count, sigma = 8_000, np.array([0.5, 1.5])
    both = draw.normal(0, 1, (count, 2))
    mix = np.sqrt([common, 1 - common])
    a, b = (sigma * (mix[0] * both + mix[1] * draw.normal(0, 1, (count, 2))) for _ in range(2))
    spread = np.tile(np.diag(sigma**2), (count, 1, 1))
    told, said = covariance_intersection(a, spread, b, spread)
    truly = told.T @ told / count
    assert np.linalg.eigvalsh(said[0] - truly).min() > -0.06
    told, said = kalman_update(a, spread, b, spread)
    truly = told.T @ told / count
    # By formula half of the variance; in truth (1 + common) / 2 of it.
    assert np.allclose(said[0], np.diag(sigma**2) / 2)
    assert np.allclose(np.diag(truly), sigma**2 * (1 + common) / 2, rtol=0.1)


def test_the_update_is_the_sum_of_what_is_known() -> None:
    draw = np.random.default_rng(5)
    a, b = draw.normal(0, 2, (2, 10, 6))
    spread_a, spread_b = spreads(10, 6, 3), spreads(10, 6, 4)
    told, spread = kalman_update(a, spread_a, b, spread_b)
    know = np.linalg.inv(spread_a) + np.linalg.inv(spread_b)
    assert np.allclose(np.linalg.inv(spread), know, atol=1e-6)
    weighted = np.linalg.solve(spread_a, a[..., None]) + np.linalg.solve(spread_b, b[..., None])
    assert np.allclose(told[..., None], np.linalg.solve(know, weighted))


def road_users(box: Floats, kind: int = CAR, score: float = 0.6, sigma_m: float = 0.3) -> Boxes:
    count = len(box)
    covariance = np.tile(np.diag([sigma_m**2, sigma_m**2, 0.04, 0.04, 1.0, 0.09]), (count, 1, 1))
    return Boxes(box, np.full(count, kind), np.full(count, score), np.zeros((count, 2)), covariance)


def cars(count: int, seed: int = 6) -> Floats:
    """Cars 12 m apart, on a square."""
    draw = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    plan = 12.0 * np.stack(np.divmod(np.arange(count), side), axis=-1)
    yaw = draw.uniform(-np.pi, np.pi, count)
    return np.column_stack([plan, np.full(count, 0.8), np.tile([4.5, 1.8, 1.6], (count, 1)), yaw])


def test_two_looks_at_the_same_become_one_that_is_nearer() -> None:
    draw = np.random.default_rng(7)
    truth = cars(100)
    parts = []
    for number in range(3):
        box = truth.copy()
        box[:, :2] += draw.normal(0, 0.3, (100, 2))
        # Detectors take fronts for backs.
        box[:, 6] += draw.normal(0, 0.1, 100) + np.pi * draw.integers(
            0, 2, 100
        )  # axes have no front
        seen = draw.random(100) < 0.8 if number else np.ones(100, bool)
        parts.append(road_users(box[draw.permutation(np.flatnonzero(seen))]))
    a, b = matched_boxes(parts[0], parts[1])
    assert len(b) == len(parts[1])
    assert np.hypot(*(parts[0].box[a, :2] - parts[1].box[b, :2]).T).max() < 3
    error = {}
    for rule in ("intersection", "kalman"):
        whole = fused_boxes(parts, rule)  # type: ignore[arg-type]
        assert len(whole) == 100
        away = np.hypot(*(whole.box[:, None, :2] - truth[None, :, :2]).transpose(2, 0, 1))
        assert sorted(away.argmin(axis=1)) == list(range(100))
        error[rule] = np.sqrt((away.min(axis=1) ** 2).mean())
        axis = truth[away.argmin(axis=1), 6] - whole.box[:, 6]
        assert np.abs(np.sin(axis)).max() < 0.5
        thrice = 1 - (1 - 0.6) ** 3
        assert whole.score.max() == pytest.approx(thrice)
    assert error["kalman"] < 0.3  # 0.42 m for one look: two coordinates of 0.3
    assert error["kalman"] < error["intersection"] < 0.42


def test_whoever_is_of_another_kind_or_far_away_stays_apart() -> None:
    one = road_users(cars(1))
    assert len(fused_boxes([one, replace(one, kind=np.array([PERSON]))])) == 2
    far = one.box.copy()
    far[:, 0] += 5.0
    assert len(fused_boxes([one, replace(one, box=far)])) == 2
    assert len(fused_boxes([one, one.only(np.zeros(0, np.int64))])) == 1
    assert len(fused_boxes([one.only(np.zeros(0, np.int64)), one])) == 1


def test_what_goes_on_as_it_did_is_where_it_is_told_to_be() -> None:
    draw = np.random.default_rng(8)
    before = road_users(cars(25))
    before = replace(before, rates=np.column_stack([draw.uniform(2, 20, 25), np.zeros(25)]))
    walkers = road_users(cars(9) + [200, 0, 0, 0, 0, 0, 0], PERSON)
    walkers = replace(walkers, rates=draw.uniform(-2, 2, (9, 2)))
    for boxes in (before, walkers):
        for seconds in (0.05, 0.3, 1.0):
            later = advanced_boxes(boxes, seconds)
            assert np.allclose(later.box[:, :2], boxes.box[:, :2] + seconds * boxes.velocity)
            assert np.allclose(later.box[:, 2:], boxes.box[:, 2:])
            grown = later.covariance - boxes.covariance
            assert (grown[:, range(4), range(4)] > 0)[:, :2].all()
        assert advanced_boxes(boxes, 0.0) is boxes
        assert advanced_boxes(boxes, -0.5) is boxes
    standing = road_users(cars(4))
    assert not moving_of(standing).any()
    assert np.allclose(advanced_boxes(standing, 1.0).box, standing.box)


@pytest.mark.thorough
def test_points_of_what_moves_move_and_all_others_stay() -> None:
    draw = np.random.default_rng(9)
    before = road_users(cars(9))
    before = replace(before, rates=np.column_stack([np.full(9, 10.0), np.full(9, 0.0)]))
    inside = np.concatenate([draw.normal(one[:3], 0.3, (40, 3)) for one in before.box])
    own = np.array([points_in_box(inside, one, 0.1) for one in before.box]).any(axis=0)
    wall = draw.uniform((-5, -5, 3), (30, 30, 4), (500, 3))
    after = advanced_boxes(before, 0.4)
    moved = advanced_points(np.concatenate([inside, wall]), before, after)
    assert (moved[len(inside) :] == wall).all()
    way = 0.4 * np.repeat(before.velocity, 40, axis=0)
    assert own.mean() > 0.9
    assert np.allclose((moved[: len(inside)] - inside)[own, :2], way[own], atol=1e-5)
    # A turn of a right angle takes what is ahead to the left.
    box = before.box[:1].copy()
    turned = box.copy()
    turned[:, 6] += np.pi / 2
    there = replace(before.only(np.array([0])), box=turned)
    c, s = np.cos(box[0, 6]), np.sin(box[0, 6])
    ahead = box[:, :3] + [2 * c, 2 * s, 0]
    left = box[:, :3] + [-2 * s, 2 * c, 0]
    assert np.allclose(advanced_points(ahead, before.only(np.array([0])), there), left, atol=1e-6)


@pytest.mark.thorough
def test_places_of_now_are_found_where_they_were_and_what_was_left_is_empty() -> None:
    before = road_users(cars(1))
    before = replace(before, rates=np.array([[10.0, 0.0]]))
    after = advanced_boxes(before, 0.6)  # 6 m on: it stands on none of where it stood
    way = after.box[0, :2] - before.box[0, :2]
    places = np.array([after.box[0, :2], before.box[0, :2], before.box[0, :2] + [40, 0]])
    then, shows = places_before(places, before, after)
    assert shows.tolist() == [True, False, True]
    assert np.allclose(then[0], places[0] - way)
    assert np.allclose(then[2], places[2])


def node(number: int, frames: int = 30, late_s: float = 0.0, ahead_s: float = 0.0) -> Node:
    looks = {
        k: Look(str(k), k / 10, k / 10 + ahead_s, k / 10, k / 10 + late_s, Pose.from_ypr([0, 0, 0]),
                Pose.from_ypr([0, 0, 0]))
        for k in range(frames)
    }  # fmt: skip
    return Node(f"n{number}", number, Path(), looks)


def test_the_frame_that_has_come_and_is_nearest_is_used() -> None:
    ego, other = node(0), node(1)
    assert latest(other, ego, 20, Channel()) == 20
    assert latest(other, ego, 20, Channel(latency_s=0.2)) == 18
    assert latest(other, ego, 20, Channel(latency_s=0.25)) == 17
    assert latest(other, ego, 20, Channel(latency_s=1.0)) == 10
    assert latest(other, ego, 20, Channel(latency_s=1.01)) is None  # older than a second
    assert latest(node(1, late_s=0.1), ego, 20, Channel(latency_s=0.1)) == 18
    assert latest(other, ego, 20, Channel(), every=7) == 14
    # A clock that is 0.3 s ahead (odd numbers are) stamps the frame of 1.7 s as of 2 s.
    assert latest(other, ego, 20, Channel(clock_error_s=0.3)) == 17
    assert latest(node(2), ego, 20, Channel(clock_error_s=0.3)) == 20  # behind: none is nearer
    assert latest(node(1, ahead_s=0.3), ego, 20, Channel()) == 17
    silent = Channel(silent=1, silent_from_s=1.5)
    assert [latest(other, ego, k, silent) for k in (14, 15, 24, 25)] == [14, 14, 14, None]
    assert latest(node(2), ego, 20, silent) == 20


@pytest.fixture(scope="module")
def model() -> Model:
    """A network that nobody trained: whatever it says, it must say the same of the same."""
    torch.set_num_threads(1)
    torch.manual_seed(1)
    design = Design(("car", "pedestrian"), range_m=12.0, cell_m=0.4, width=0.25)
    network = new_network(design).eval()
    for head in network.heads:
        head[-1].weight.data *= 30  # type: ignore[index, union-attr]
        head[-1].bias.data[0] = -1.5  # type: ignore[index, union-attr]
    return Model(design, network, {})


def scene(seed: int = 10) -> tuple[Floats, Floats]:
    """Flat ground about the origin, and what stands on it, in the site."""
    draw = np.random.default_rng(seed)
    ground = np.column_stack([draw.uniform(-20, 20, (6000, 2)), np.zeros(6000)])
    stands = np.concatenate(
        [draw.uniform(-0.5, 0.5, (60, 3)) * [2, 2, 1] + [x, y, 0.9] for x, y in
         draw.uniform(-8, 8, (12, 2))]
    )  # fmt: skip
    return ground, stands


def looked(points: Floats, site_SE3_node: Pose) -> Frame:
    return Frame(site_SE3_node.inverse().apply(points), sensor_places=np.zeros((1, 3)))


def test_cells_along_the_site_are_the_same_for_all_nodes(model: Model) -> None:
    ground, stands = scene()
    points = np.concatenate([ground, stands])
    mine = encoded(model, looked(points, at := Pose.from_ypr([0.13, -0.2, 4], 0.4)), at,
                   along_site=True)  # fmt: skip
    there = Pose.from_ypr([1.71, 2.05, 5], -1.2)
    other = encoded(model, looked(points, there), there, along_site=True)
    told = chosen_cells(other, None, 1)
    cell, values = warped(told, other.site_SE3_map, mine)
    row, column = np.divmod(mine.cell, mine.grid.cells)
    inner = (row > 9) & (row < 50) & (column > 9) & (column < 50)  # seen by both
    at_cell = {one: k for k, one in enumerate(cell.tolist())}
    both = np.array([at_cell.get(one, -1) for one in mine.cell[inner].tolist()])
    assert (both >= 0).mean() > 0.999  # a point on the border of two cells
    off = np.abs(values[both] - mine.values[inner]).max(axis=1)
    assert (off < 2e-3).mean() > 0.99


def test_what_two_nodes_see_apart_is_merged_to_what_one_would_see(model: Model) -> None:
    ground, stands = scene()
    west = np.concatenate([ground, stands])[:, 0] < 0.0
    points = np.concatenate([ground, stands])
    here, there = Pose.from_ypr([0, 0, 4.0], 0.7), Pose.from_ypr([0.4, 1.2, 5.0], 2.0)
    whole = encoded(model, looked(points, here), here, along_site=True)
    mine = encoded(model, looked(points[west], here), here, along_site=True)
    other = encoded(model, looked(points[~west], there), there, along_site=True)
    told = chosen_cells(other, None, 1)
    canvas = merged(mine, [warped(told, other.site_SE3_map, mine)])
    alone = merged(whole, [])
    row, column = np.divmod(np.arange(len(canvas)), mine.grid.cells)
    inner = (np.abs(row - 30) < 20) & (np.abs(column - 30) < 20)
    off = np.abs(canvas - alone).max(axis=1)
    assert (off[inner] < 2e-3).mean() > 0.95  # the border of both halves runs through cells


def test_cells_of_one_node_say_what_the_detector_says_of_its_frame(model: Model) -> None:
    points = np.concatenate(scene())
    here = Pose.from_ypr([0, 0, 4.0])
    frame = looked(points, here)
    wanted, _ = found_in(model, frame, least=0.02)
    known = encoded(model, frame, here, along_site=True)
    found = detected_in_cells(model, known, merged(known, []), 0.02)
    assert len(wanted.box) > 5
    assert np.allclose(found.box, wanted.box + [0, 0, 4, 0, 0, 0, 0], atol=1e-3)
    assert np.allclose(found.score, wanted.score, atol=1e-4)


def test_along_the_nodes_axes_every_cell_shows_the_one_that_its_middle_is_in(model: Model) -> None:
    ground, stands = scene()
    points = np.concatenate([ground, stands])
    here, there = Pose.from_ypr([0, 0, 4.0]), Pose.from_ypr([2.0, -1.0, 5.0], 0.9)
    mine = encoded(model, looked(points, here), here, along_site=True)
    other = encoded(model, looked(points, there), there, along_site=False)
    told = chosen_cells(other, None, 1)
    cell, values = warped(told, other.site_SE3_map, mine)
    middle = mine.grid.middles(cell) + here.translation[:2]
    source = (middle - there.translation[:2]) @ np.array(
        [[np.cos(0.9), -np.sin(0.9)], [np.sin(0.9), np.cos(0.9)]]
    )
    nearest = other.grid.middles(told.cell)
    away = np.abs(source[:, None] - nearest[None]).max(axis=2)
    assert (away.min(axis=1) <= 0.2 + 1e-3).all()
    assert (values == told.values[away.argmin(axis=1)]).all()


def test_the_likeliest_cells_are_told_and_coarser_ones_hold_the_greatest(model: Model) -> None:
    ground, stands = scene()
    here = Pose.from_ypr([0, 0, 4.0])
    known = encoded(model, looked(np.concatenate([ground, stands]), here), here, along_site=True)
    few = chosen_cells(known, 50, 1)
    kept = np.isin(known.cell, few.cell)
    assert kept.sum() == 50
    assert known.likely[kept].min() >= known.likely[~kept].max() - 1e-6
    coarse = chosen_cells(known, None, 2)
    row, column = np.divmod(known.cell, known.grid.cells)
    for number in (0, len(coarse.cell) // 2, len(coarse.cell) - 1):
        r, c = divmod(int(coarse.cell[number]), coarse.cells)
        members = (row // 2 == r) & (column // 2 == c)
        assert (coarse.values[number] == known.values[members].max(axis=0)).all()
    assert coarse.cell_m == pytest.approx(0.8)
