"""Replay: our own motion there and back again, gaps, noise, and a real recording."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.artefact.privacy import search_files
from urbantwin.cli import main
from urbantwin.dataset.named_inputs import named_inputs
from urbantwin.errors import InputError
from urbantwin.exports.tracks import write_openlabel, write_tracks
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.assets import asset
from urbantwin.traffic.assets.asset_name import AssetName
from urbantwin.traffic.recorded.csv_rows import csv_rows
from urbantwin.traffic.recorded.description import TracksSpec
from urbantwin.traffic.recorded.track import RecordedTrack
from urbantwin.traffic.recorded.track_smoothing import smooth_positions, smooth_track
from urbantwin.traffic.replay import replay
from urbantwin.twin import Twin

SECONDS = 4.0


@pytest.fixture(scope="module")
def motion(brief_twin: Twin, tmp_path_factory: pytest.TempPathFactory) -> Motion:
    folder = tmp_path_factory.mktemp("driven") / "motion"
    run_traffic(brief_twin, folder, seconds=SECONDS)
    return Motion.load(folder)


def test_the_clock_and_the_names_stay_outside_unless_asked_for(
    motion: Motion, brief_twin: Twin, tmp_path: Path
) -> None:
    file = tmp_path / "tracks.csv"
    write_tracks(motion, file)
    lines = file.read_text().splitlines()
    began = 1_627_218_181.5
    column = {name.strip('"'): k for k, name in enumerate(lines[0].split(","))}
    rows = [line.split(",") for line in lines[1:]]
    time, track = "time_s", "track_id"
    first = rows[0][column[track]]
    for row in rows:
        row[column[time]] = f"{float(row[column[time]]) + began:.6f}"
        if row[column[track]] == first:
            row[column[track]] = "B-MW 1234"
    file.write_text("\n".join([lines[0], *(",".join(row) for row in rows)]) + "\n")

    replay(brief_twin, file, tmp_path / "again", smooth=False)
    text = (tmp_path / "again" / "motion.json").read_text()
    assert "1627218181" not in text
    assert "B-MW" not in text
    assert search_files(tmp_path / "again") == []
    assert main(["dataset", "verify", str(tmp_path / "again"), "--privacy", "-q"]) == 0

    described = tmp_path / "tracks.yaml"
    terms = {"licence": "CC BY-NC-SA 4.0", "attribution": "somebody"}
    described.write_text(yaml.safe_dump({"tracks": file.name, **terms}))
    kept = tmp_path / "kept"
    arguments = [
        "traffic",
        "replay",
        described,
        "--twin",
        brief_twin.folder,
        "-o",
        kept,
        "--no-pictures",
        "-q",
    ]
    assert main([*map(str, arguments), "--keep-clock", "--keep-names"]) == 0
    told = Motion.load(kept).manifest["recorded"]
    inputs = named_inputs(brief_twin.manifest, Motion.load(kept).manifest, None)
    of_tracks = [one for one in inputs if one["kind"] == "tracks"]
    assert [one["name"] for one in of_tracks] == ["tracks.yaml", "tracks.csv"]
    assert all(terms.items() <= one.items() for one in of_tracks)
    assert told["begins_s"] == pytest.approx(began)
    assert "B-MW 1234" in told["names"].values()
    assert {one.what for one in search_files(kept)} == {"time stamp"}
    assert main(["dataset", "verify", str(kept), "--privacy", "-q"]) == 2
    assert ut.dataset.verify(kept, progress=False)
    assert not ut.dataset.verify(kept, privacy=True, progress=False)


def track_of(times: np.ndarray, xy: np.ndarray, yaw: float = np.nan) -> RecordedTrack:
    nothing = np.full(len(times), np.nan)
    return RecordedTrack("a", "car", times, xy, nothing + yaw, nothing, np.full(3, np.nan))


@pytest.mark.parametrize("write", [write_tracks, write_openlabel])
def test_a_motion_comes_back_as_it_was(
    motion: Motion,
    brief_twin: Twin,
    write: Callable[[Motion, Path], None],
    tmp_path: Path,
    records: Callable[..., np.recarray],
) -> None:
    file = tmp_path / ("tracks.csv" if write is write_tracks else "labels.json")
    write(motion, file)
    again = replay(brief_twin, file, tmp_path / "again", smooth=False)
    before, after = records(motion.actors), records(again.actors)
    names = {int(key): int(name) for key, name in again.manifest["recorded"]["names"].items()}
    track = np.array([names[one] for one in after.track])
    there = dict(zip(zip(track, np.round(after.time_s, 6), strict=True), after, strict=True))
    rows = [(row, there[row.track, round(row.time_s, 6)]) for row in before]
    # Nobody is lost, and nobody is added but in the gaps of those who were left out for a step.
    assert len(after) == len(before) + sum(
        round((one["to_s"] - one["from_s"]) / motion.step_s) - 1
        for one in again.manifest["recorded"]["filled"]
    )
    for name, tolerance in {"x": 1e-5, "y": 1e-5, "z": 0.01, "pitch": 0.01, "roll": 0.01}.items():
        away = [abs(a[name] - b[name]) for a, b in rows]
        assert max(away) < tolerance, name
    turned = [abs(np.angle(np.exp(1j * (a.yaw - b.yaw)))) for a, b in rows]
    assert max(turned) < 1e-5
    vehicles = [(a, b) for a, b in rows if a["class"] not in ("pedestrian",)]
    assert np.mean([a.lane == b.lane for a, b in vehicles]) > 0.9
    for side in ("length", "width", "height"):
        # A person's box is that of the moment, a track's size is one.
        away = [abs(a[side] - b[side]) for a, b in vehicles]
        assert max(away) < 0.011, side
    Motion.load(tmp_path / "again")


def test_people_are_as_tall_as_recorded_and_not_flattened_to_their_boxes(
    brief_twin: Twin, tmp_path: Path
) -> None:
    rows = "\n".join(f"1,{k / 2},pedestrian,2,{0.6 * k},0.6,0.6,1.60" for k in range(6))
    (tmp_path / "t.csv").write_text(f"track,time_s,class,x,y,length,width,height\n{rows}\n")
    motion = replay(brief_twin, tmp_path / "t.csv", tmp_path / "motion")
    (name,) = set(motion.actors["asset"].to_pylist())
    body, size = AssetName.of(name).body, AssetName.of(name).size
    assert size is not None
    own = [asset(body).length, asset(body).width, asset(body).height]
    assert size[2] == pytest.approx(1.60, abs=0.01)
    assert np.divide(size, own) == pytest.approx(1.60 / own[2], abs=0.02)


def test_gaps_are_filled_and_marked_or_left_open() -> None:
    times = np.round(np.arange(0, 12, 0.1), 9)
    keep = ((times < 3) | (times > 4)) & ((times < 6) | (times > 9.05))
    xy = np.column_stack([10 * times, np.zeros_like(times)])
    one = smooth_track(track_of(times[keep], xy[keep]), 0.1)
    assert one is not None
    assert one.filled == (pytest.approx((2.9, 4.1)),)
    assert one.absent == (pytest.approx((5.9, 9.1)),)
    assert not ((one.time_s > 5.95) & (one.time_s < 9.05)).any()
    assert one.xy[:, 0] == pytest.approx(10 * one.time_s, abs=0.01)
    assert one.speed == pytest.approx(10.0, abs=0.01)


def test_noise_is_taken_off_and_a_leap_is_no_path() -> None:
    random = np.random.default_rng(4)
    times = np.arange(0, 20, 0.1)
    turn = 0.05 * times
    true = np.column_stack([150 * np.sin(turn), 150 * (1 - np.cos(turn))])  # 7.5 m/s on a circle
    noisy = true + random.normal(0, 0.1, true.shape)
    noisy[1] += [2.0, 0.0]  # a tracker that begins
    one = smooth_track(track_of(times, noisy), 0.1)
    assert one is not None
    before = np.linalg.norm(noisy - true, axis=1)
    after = np.linalg.norm(one.xy - true, axis=1)
    assert np.sqrt((after[5:-5] ** 2).mean()) < 0.6 * np.sqrt((before[5:-5] ** 2).mean())
    assert after[1] < 0.3
    assert one.speed[10:-10] == pytest.approx(7.5, abs=0.6)
    assert np.abs(one.yaw - turn)[10:-10].max() < np.radians(4)


def test_who_stands_keeps_the_heading() -> None:
    random = np.random.default_rng(5)
    times = np.arange(0, 20, 0.1)
    gone = np.minimum(8 * times, 40.0)  # drives north for 5 s and waits
    xy = np.column_stack([np.zeros_like(gone), gone]) + random.normal(0, 0.03, (len(gone), 2))
    one = smooth_track(track_of(times, xy), 0.1)
    assert one is not None
    assert np.abs(one.yaw[70:] - np.pi / 2).max() < np.radians(8)
    assert np.ptp(one.yaw[80:]) < 1e-9


def test_tracks_beside_the_twin_are_refused(brief_twin: Twin, tmp_path: Path) -> None:
    rows = "\n".join(f"1,{k / 10},car,{500 + k},0" for k in range(20))
    (tmp_path / "t.csv").write_text(f"track,time_s,class,x,y\n{rows}\n")
    with pytest.raises(InputError, match=r"t\.csv: none of its tracks comes onto the ground"):
        replay(brief_twin, tmp_path / "t.csv", tmp_path / "motion")
    assert not (tmp_path / "motion").exists()


@pytest.mark.thorough
def test_the_recording_of_karlsruhe_is_told_between_its_moments(shared_data: Path) -> None:
    file = shared_data / "tracks" / "karlsruhe-k733" / "vehicle_tracks_000.csv"
    rows = csv_rows(file, TracksSpec(tracks=file.name))
    away, pull = [], []
    for name in sorted(set(rows.track)):
        mine = np.flatnonzero(rows.track == name)
        if len(mine) < 40:
            continue
        held = np.arange(len(mine)) % 5 == 2
        held[:10] = False  # its tracker begins
        times, xy = rows.time_s[mine], rows.xyz[mine, :2]
        at, velocity = smooth_positions(times[~held], xy[~held], times)
        away.append(np.linalg.norm(at - xy, axis=1)[held])
        pull.append(np.linalg.norm(np.gradient(velocity, times, axis=0), axis=1)[5:-5])
    assert np.sqrt(np.mean(np.concatenate(away) ** 2)) < 0.12
    assert np.quantile(np.concatenate(pull), 0.99) < 8.5  # of the file's own: 60


def test_signals_stand_at_the_stop_lines_of_those_who_pass_at_green(
    brief_twin: Twin, tmp_path: Path, records: Callable[..., np.recarray]
) -> None:
    heads = {head.lane: head for head in brief_twin.roads.signals}
    west = heads["wc_1"]
    # Ten from the west pass from 42 s on, where a is green; c's stop line is told, d is dark.
    rows = [
        f"{number},{(420 + 30 * number + k) / 10},car,{west.x - 30 + 1.2 * k},{west.y}"
        for number in range(10)
        for k in range(80)
    ]
    (tmp_path / "t.csv").write_text("track,time_s,class,x,y\n" + "\n".join(rows) + "\n")
    states = [("a", 0, "red"), ("a", 20, "green"), ("a", 50, "yellow"), ("a", 53, "red")]
    states += [("b", 0, "green"), ("b", 19, "yellow"), ("b", 22, "red")]
    states += [("c", 0, "red"), ("c", 30, "green"), ("d", 0, "dark")]
    table = "\n".join(f"{group},{at + 22},{state}" for group, at, state in states)
    (tmp_path / "s.csv").write_text(f"g,t,s\n{table}\n")
    (tmp_path / "t.yaml").write_text(
        "tracks: t.csv\nsignals:\n  {file: s.csv, group: g, time: t, state: s, unit: s,\n"
        "   places: {c: [[1.0, 2.0]]}}\n"
    )
    motion = replay(brief_twin, tmp_path / "t.yaml", tmp_path / "motion")
    shown = records(motion.signals)
    told = shown[shown.signal == "recorded"]
    assert list(zip(told.time_s, told.state, told.x, told.y, strict=True)) == [
        (0.0, "r", 1.0, 2.0),
        (10.0, "G", 1.0, 2.0),
    ]
    own = shown[(shown.signal == west.program) & (shown.x == west.x) & (shown.y == west.y)]
    assert set(zip(own.time_s, own.state, strict=True)) == {
        (0.0, "G"),
        (30.0, "y"),
        (33.0, "r"),
    }
    assert "groups b are left out" in motion.manifest["warnings"][-1]["problem"]


@pytest.mark.parametrize(
    "command",
    [
        ["traffic", "replay", "none.yaml", "--twin", "twin", "-o", "motion"],
        ["traffic", "calibrate", "none.csv", "--site", "none.yaml", "-o", "calibrated"],
    ],
)
def test_what_is_not_there_is_one_line(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(command) == 2
    error = capsys.readouterr().err.strip()
    assert "not found" in error
    assert "\n" not in error


def test_a_person_of_whom_one_moment_is_known_is_in_a_step_where_it_is_as_long(
    brief_twin: Twin, tmp_path: Path
) -> None:
    rows = "1,0,pedestrian,2,0,0.75,0.6,1.7\n2,0,pedestrian,4,0,0.6,0.6,1.7\n3,1,car,9,0,4,2,1.5"
    (tmp_path / "t.csv").write_text(f"track,time_s,class,x,y,length,width,height\n{rows}\n")
    motion = replay(brief_twin, tmp_path / "t.csv", tmp_path / "motion")
    of = {one["track"]: one for one in motion.actors.to_pylist()}
    halted = {track: of[track]["phase"] == asset(of[track]["asset"]).standing for track in (1, 2)}
    assert halted == {1: False, 2: True}
