"""Traffic on a signalised crossing, judged from the motion's own tables and the network's XML."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from urbantwin.errors import InputError
from urbantwin.geometry import Pose
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.assets import asset
from urbantwin.traffic.paths.coupling import towed_by
from urbantwin.twin import Twin

WARMUP_S, SECONDS = 60.0, 40.0


@pytest.fixture(scope="module")
def motion(real_drive: Callable[[str], tuple[Twin, Motion]]) -> Motion:
    return real_drive("crossing")[1]


@pytest.fixture(scope="module")
def actors(motion: Motion, records: Callable[..., np.recarray]) -> np.recarray:
    return records(motion.actors)


@pytest.fixture(scope="module")
def signals(motion: Motion, records: Callable[..., np.recarray]) -> np.recarray:
    return records(motion.signals)


@pytest.fixture(scope="module")
def links(crossing_net: Path) -> dict[tuple[str, str], int]:
    """The signal's links by (lane before, lane over the junction), from the network's XML."""
    found, beyond = {}, {}
    for item in ElementTree.parse(crossing_net).getroot().iter("connection"):
        start = f"{item.get('from')}_{item.get('fromLane')}"
        end = f"{item.get('to')}_{item.get('toLane')}"
        if item.get("tl"):
            # A walker goes over the crossing, which is where the connection ends.
            found[start, item.get("via") or end] = int(item.get("linkIndex"))
        beyond[start] = end
    # A crossing is named once and walked both ways.
    both = {(beyond[over], over): link for (_, over), link in found.items() if "_c" in over}
    return found | both


def by_track(rows: np.recarray) -> Iterator[np.recarray]:
    """The rows of each actor, in order of time."""
    rows = rows[np.argsort(rows.track, kind="stable")]
    yield from np.split(rows, np.flatnonzero(np.diff(rows.track)) + 1)


def fronts(rows: np.recarray) -> np.ndarray:
    ahead = np.column_stack([np.cos(rows.yaw), np.sin(rows.yaw)])
    return np.column_stack([rows.x, rows.y]) + ahead * rows.length[:, None] / 2


def shown(signals: np.recarray, link: int, time_s: float) -> str:
    rows = signals[(signals.link == link) & (signals.time_s <= time_s + 1e-9)]
    return str(rows.state[np.argmax(rows.time_s)])


def test_nobody_passes_a_red_signal(
    actors: np.recarray, signals: np.recarray, links: dict[tuple[str, str], int]
) -> None:
    passed: dict[str, list[str]] = defaultdict(list)
    for rows in by_track(actors):
        for k in np.flatnonzero(rows.lane[1:] != rows.lane[:-1]):
            link = links.get((rows.lane[k], rows.lane[k + 1]))
            if link is not None:
                passed[rows["class"][0]].append(shown(signals, link, rows.time_s[k + 1]))
    assert len(passed["car"]) > 10
    assert len(passed["pedestrian"]) > 3
    assert {name: states for name, states in passed.items() if "r" in states} == {}


def test_who_waits_at_red_stands_behind_the_stop_line(
    actors: np.recarray, signals: np.recarray, links: dict[tuple[str, str], int]
) -> None:
    of_lane: dict[str, list[int]] = defaultdict(list)
    for (start, _), link in links.items():
        of_lane[start].append(link)
    waiting = actors[(actors["class"] != "pedestrian") & (actors.speed < 0.1)]
    waiting = waiting[np.isin(waiting.lane, list(of_lane))]
    checked = 0
    for row, front in zip(waiting[::7], fronts(waiting)[::7], strict=True):
        known = of_lane[row.lane]
        if all(shown(signals, link, row.time_s) == "r" for link in known):
            line = signals[signals.link == known[0]][0]
            # The junction's middle is the origin: who is behind the line is farther from it.
            assert np.linalg.norm(front) > np.hypot(line.x, line.y) - 0.3
            checked += 1
    assert checked > 50


def test_the_signal_table_says_where_each_link_stops(
    signals: np.recarray, crossing_net: Path, links: dict[tuple[str, str], int]
) -> None:
    shapes = {
        lane.get("id"): np.array([point.split(",") for point in lane.get("shape").split()], float)
        for lane in ElementTree.parse(crossing_net).getroot().iter("lane")
    }
    assert set(signals[signals.time_s == 0].link) == set(links.values())
    for (start, over), link in links.items():
        places = signals[signals.link == link]
        if "_c" not in over:
            np.testing.assert_allclose(places.x, shapes[start][-1][0])
            np.testing.assert_allclose(places.y, shapes[start][-1][1])


def test_every_class_comes_as_often_as_asked(
    motion: Motion, actors: np.recarray, per_hour: dict[str, float]
) -> None:
    towed = towed_by(motion.actors)
    shown = (rows for rows in by_track(actors) if rows.track[0] not in towed)
    seen = Counter(rows["class"][0] for rows in shown)
    for name, rate in per_hour.items():
        counts = motion.manifest["classes"][name]
        assert abs(counts["asked"] - rate * (WARMUP_S + SECONDS) / 3600) <= 1
        assert counts["driven"] >= 0.8 * counts["asked"]
        assert counts["seen"] == seen[name]
    assert motion.manifest["left_out"] == []


def test_the_streets_are_populated_from_the_first_step(actors: np.recarray) -> None:
    first = Counter(actors[actors.time_s == 0]["class"])
    assert first["car"] >= 8
    assert first["pedestrian"] >= 8


def test_the_same_seed_gives_the_same_bytes_and_another_seed_another_motion(
    brief_twin: Twin, tmp_path: Path
) -> None:
    seeds = {"one": 1, "again": 1, "other": 2}
    made = {
        name: run_traffic(brief_twin, tmp_path / name, seconds=2, seed=seed)
        for name, seed in seeds.items()
    }
    for file in ("actors.parquet", "signals.parquet", "motion.json"):
        assert (tmp_path / "again" / file).read_bytes() == (tmp_path / "one" / file).read_bytes()
    assert made["again"].sha256() == made["one"].sha256()
    assert made["other"].sha256() != made["one"].sha256()
    assert not made["other"].actors.equals(made["one"].actors)


def test_wheels_touch_the_slope(actors: np.recarray, slope: np.ndarray) -> None:
    for row in actors[::23]:
        pose = Pose.from_ypr([row.x, row.y, row.z], row.yaw, row.pitch, row.roll)
        wheels = pose.apply(asset(row.asset).contacts)
        assert np.abs(wheels[:, 2] - wheels[:, :2] @ slope).max() < 0.001


def test_vehicles_keep_to_the_limit(actors: np.recarray, limit_ms: float) -> None:
    walks = actors["class"] == "pedestrian"
    assert 0.8 * limit_ms < actors[~walks].speed.max() <= 1.2 * limit_ms
    assert actors[walks].speed.max() < 2.5


def test_positions_follow_speed_and_heading(actors: np.recarray, limit_ms: float) -> None:
    turned, apart = [], []
    for rows in by_track(actors):
        step = np.column_stack([np.diff(rows.x), np.diff(rows.y)])
        speed, yaw = rows.speed[1:], rows.yaw[1:]
        length = np.linalg.norm(step, axis=1)
        apart += list(np.abs(length - speed * 0.1))
        course = np.arctan2(step[:, 1], step[:, 0])
        turned += list(np.abs(np.angle(np.exp(1j * (course - yaw))))[speed > 1.5])
        turn = np.abs(np.angle(np.exp(1j * np.diff(rows.yaw))))
        ahead = step[:, 0] * np.cos(yaw) + step[:, 1] * np.sin(yaw)
        assert length.max(initial=0) < 0.1 * 1.2 * limit_ms + 0.25, "nobody leaps"
        assert turn[speed < 0.01].max(initial=0) < 5e-3, "nobody turns on the spot"
        # A pedestrian stuck among others steps back at 0.5 m/s, and a little more to the side.
        back = 0.06 if rows["class"][0] == "pedestrian" else 0.01
        assert ahead.min(initial=0) > -back, "nobody slides backwards"
    assert np.quantile(apart, 0.99) < 0.06
    assert np.degrees(np.quantile(turned, 0.99)) < 12


def test_a_car_is_in_its_lane(actors: np.recarray, crossing_twin: Twin) -> None:
    cars = actors[(actors["class"] == "car") & ~np.char.startswith(actors.lane.astype(str), ":")]
    inside: list[bool] = []
    for name in np.unique(cars.lane):
        lane = crossing_twin.roads.lane_by_id[name]
        # SUMO's lane is the one under the middle of the front.
        ahead = fronts(cars[cars.lane == name])
        inside += list(shapely.contains_xy(lane.polygon.buffer(0.3), ahead))
    assert len(inside) > 3000
    assert np.mean(inside) > 0.98


def test_a_walker_makes_one_cycle_of_steps_per_stride(actors: np.recarray) -> None:
    checked = 0
    for rows in by_track(actors[actors["class"] == "pedestrian"]):
        if len(rows) < 100 or rows.speed.min() < 0.8:
            continue
        mesh = asset(rows.asset[0])
        forward = np.diff(rows.phase.astype(int)) % mesh.phases
        walked = np.hypot(np.diff(rows.x), np.diff(rows.y)).sum()
        cycles = forward.sum() / mesh.phases
        assert set(rows.phase) == set(range(mesh.phases))
        assert forward.max() <= 3, "postures follow each other"
        assert cycles == pytest.approx(walked / mesh.stride_m, rel=0.1, abs=0.2)
        checked += 1
    assert checked >= 3


def test_who_waits_stands(actors: np.recarray) -> None:
    for name in ("pedestrian", "bicycle", "motorcycle"):
        rows = actors[actors["class"] == name]
        halted = rows.phase == np.array([asset(each).standing for each in rows.asset])
        assert halted[rows.speed < 0.01].all()
        assert not halted[rows.speed > 0.5].any()
    assert (rows.speed < 0.01).any()


def test_nobody_is_in_anybody(motion: Motion, actors: np.recarray) -> None:
    towed = towed_by(motion.actors)
    for time_s in np.unique(actors.time_s)[::5]:
        rows = actors[actors.time_s == time_s]
        turned = np.exp(1j * rows.yaw)[:, None] / 2
        sides = np.array([1 + 1j, 1 - 1j, -1 - 1j, -1 + 1j])
        corners = (
            sides.real * rows.length[:, None] + 1j * sides.imag * rows.width[:, None]
        ) * turned
        corners += (rows.x + 1j * rows.y)[:, None]
        boxes = shapely.polygons(np.stack([corners.real, corners.imag], axis=-1))
        one, other = shapely.STRtree(boxes).query(boxes, predicate="intersects")
        whose = np.array([towed.get(track, track) for track in rows.track.tolist()])
        pairs = whose[one] < whose[other]
        one, other = one[pairs], other[pairs]
        assert (shapely.area(shapely.intersection(boxes[one], boxes[other])) <= 0.05).all()


def test_walkers_stay_upright(actors: np.recarray) -> None:
    walkers = actors[actors["class"] == "pedestrian"]
    assert (walkers.pitch == 0).all()
    assert (walkers.roll == 0).all()


def test_tracks_and_times_are_in_order(motion: Motion, actors: np.recarray) -> None:
    assert list(motion.times()[:4]) == [0.0, 0.1, 0.2, 0.3]
    assert len(motion.times()) == 400
    assert set(actors.time_s) <= set(motion.times())
    assert (np.lexsort([actors.track, actors.time_s]) == np.arange(len(actors))).all()
    assert set(actors.track) == set(range(1, actors.track.max() + 1))
    assert len({(row.time_s, row.track) for row in actors}) == len(actors)


def test_progress_is_told_and_sumo_says_nothing_on_our_streams(
    brief_twin: Twin, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    told: list[float] = []
    run_traffic(brief_twin, tmp_path / "m", seconds=1, progress=lambda f, _: told.append(f))
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert told == sorted(told)
    assert len(told) > 20
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("seconds", "seed"), [(0.0, 1), (-5.0, 1), (float("nan"), 1), (5.0, -1)])
def test_senseless_requests_are_refused(
    crossing_twin: Twin, tmp_path: Path, seconds: float, seed: int
) -> None:
    with pytest.raises(InputError):
        run_traffic(crossing_twin, tmp_path / "m", seconds=seconds, seed=seed)
    assert not list(tmp_path.iterdir())


def test_nothing_asked_for_gives_an_empty_motion(
    crossing_net: Path, twin_of: Callable[..., Twin], per_hour: dict[str, float], tmp_path: Path
) -> None:
    twin = twin_of(tmp_path / "twin", crossing_net, dict.fromkeys(per_hour, 0.0))
    motion = run_traffic(twin, tmp_path / "motion", seconds=2)
    assert motion.actors.num_rows == 0
    assert len(motion.times()) == 20
    assert len(motion.at(1.0)) == 0
    assert motion.signals.num_rows > 0
