"""What moves in frames with rings: of sensors that look at a made world of closed form."""

import itertools
import json

import numpy as np
import pandas as pd
import pytest
import shapely

import urbantwin as ut
from urbantwin.errors import InputError
from urbantwin.fidelity.discovery.blind_sectors import losses_of
from urbantwin.reconstruct import TriangleMesh
from urbantwin.reconstruct.recording import Looks, RecordedFrames, moving_points
from urbantwin.reconstruct.recording.beams import recorded_beams
from urbantwin.reconstruct.recording.recorded_world import read_recording
from urbantwin.reconstruct.recording.standing_things import standing_things, waiting_parts
from urbantwin.taxonomy import semantic_id
from urbantwin.traffic.observed import observe

COLUMNS, RINGS = 360, 12
PLACES = np.array([[0.0, 0.0, 3.0], [12.0, 5.0, 4.0]])


def write_recording(folder, frames=8):
    """Two sensors over level ground within a round wall of 30 m; a column of 1 m drives through.

    Returns which points are of the column, frame by frame.
    """
    for part in ("points", "rays"):
        (folder / part).mkdir(parents=True)
    sensors = [
        {"name": f"sensor-{n}", "east_m": x, "north_m": y, "up_m": z, "pitch_deg": 0.0}
        | {"roll_deg": 0.0, "columns": COLUMNS, "channels": RINGS}
        for n, (x, y, z) in enumerate(PLACES.tolist())
    ]
    (folder / "discovery.json").write_text(json.dumps({"kind": "discovery", "sensors": sensors}))
    rng = np.random.default_rng(0)
    ring, column = (grid.ravel() for grid in np.mgrid[:RINGS, :COLUMNS])
    up, around = np.radians(-20 + 2.0 * ring), -np.radians(column)
    ways = np.column_stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    truth = []
    for frame in range(frames):
        points, moves, rays = [], [], []
        for number, place in enumerate(PLACES):
            down = np.where(ways[:, 2] < 0, -place[2] / np.minimum(ways[:, 2], -1e-9), np.inf)
            wall = round_wall(place[:2], ways, np.zeros(2), 30.0, far=True)
            driven = round_wall(place[:2], ways, np.array([-9.0 + 3.0 * frame, 9.0]), 1.0)
            meets = np.isfinite(driven)
            over = place[2] + driven[meets] * ways[meets, 2] > 2.5
            driven[np.flatnonzero(meets)[over]] = np.inf
            range_m = np.minimum(np.minimum(down, wall), driven)
            moves.append(driven <= np.minimum(down, wall))
            noisy = range_m + rng.normal(0, 0.01, len(range_m))
            points.append(place + ways * noisy[:, None])
            table = np.zeros(len(ways), [("sensor", "<i2"), ("ring", "<i2"), ("column", "<i4")])
            table["sensor"], table["ring"], table["column"] = number, ring, column
            rays.append(table)
        np.save(folder / "points" / f"{frame:04d}.npy", np.concatenate(points).astype("<f4"))
        np.save(folder / "rays" / f"{frame:04d}.npy", np.concatenate(rays))
        truth.append(np.concatenate(moves))
    return truth


def round_wall(place, ways, middle, radius, *, far=False):
    """Range along (N, 3) ways from (2,) to an upright cylinder, inf where none."""
    to = place - middle
    a, b = (ways[:, :2] ** 2).sum(axis=1), ways[:, :2] @ to
    inside = b**2 - a * (to @ to - radius**2)
    root = np.sqrt(np.maximum(inside, 0))
    range_m = (-b + (root if far else -root)) / a
    return np.where((inside > 0) & (range_m > 0), range_m, np.inf)


def test_what_drives_through_moves_and_nothing_else_does(tmp_path):
    truth = write_recording(tmp_path)
    frames = RecordedFrames(tmp_path)
    assert len(frames) == 8
    assert [one.name for one in frames.sensors] == ["sensor-0", "sensor-1"]
    found = list(moving_points(frames))
    moved, seen = np.concatenate(truth), np.concatenate(found)
    height = np.concatenate([frames.read(number).points[:, 2] for number in range(8)])
    assert moved.sum() > 200
    assert seen[moved & (height > 0.4)].mean() > 0.99  # feet lie within reach of the ground
    assert seen[~moved].mean() < 0.001


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (lambda folder: (folder / "discovery.json").unlink(), "holds no discovery.json"),
        (lambda folder: (folder / "rays" / "0001.npy").unlink(), "not found"),
        (lambda folder: np.save(folder / "rays" / "0001.npy", np.zeros(3)), "is an array of"),
        (
            lambda folder: [f.unlink() for f in (folder / "points").glob("000[4-9].npy")],
            "not show what is static",
        ),
    ],
)
def test_a_recording_that_cannot_be_used_is_one_line(tmp_path, break_it, said):
    write_recording(tmp_path)
    break_it(tmp_path)
    with pytest.raises(InputError, match=said) as error:
        list(moving_points(RecordedFrames(tmp_path)))
    assert "\n" not in str(error.value)


def test_the_world_is_the_ground_and_the_wall_and_nothing_that_drove(tmp_path):
    write_recording(tmp_path)
    world = read_recording(tmp_path)
    ground = world.cloud.points
    inner = np.hypot(*ground[:, :2].T) < 28
    assert np.abs(ground[inner, 2]).max() < 0.05
    assert (world.cloud.classification[inner] == 2).mean() > 0.6
    corners = world.mesh.vertices[world.mesh.faces]
    solid = world.mesh.object == 0
    off = np.abs(np.hypot(corners[..., 0], corners[..., 1]) - 30.0)
    assert np.median(off[solid]) < 0.02
    assert np.percentile(off[solid], 99) < 0.1
    assert off.max() < 1.0  # no triangle where the column drove
    wall = corners[solid]
    area = np.linalg.norm(np.cross(wall[:, 1] - wall[:, 0], wall[:, 2] - wall[:, 0]), axis=1) / 2
    assert area.sum() > 100
    # Any number of times the same.
    again = read_recording(tmp_path)
    assert (again.mesh.vertices == world.mesh.vertices).all()
    assert (again.mesh.faces == world.mesh.faces).all()


def test_frames_of_two_places_are_refused(tmp_path):
    write_recording(tmp_path)
    for number in range(1, 8, 2):
        file = tmp_path / "points" / f"{number:04d}.npy"
        points = np.load(file)
        points[:, :2] += 4.0 * number
        np.save(file, points)
    with pytest.raises(InputError, match="static"):
        read_recording(tmp_path)
    with pytest.raises(InputError, match="static"):
        observe(RecordedFrames(tmp_path))


def test_frames_of_which_no_point_is_on_a_ring_are_refused(tmp_path):
    write_recording(tmp_path)
    for file in (tmp_path / "rays").iterdir():
        rays = np.load(file)
        for name in rays.dtype.names:
            rays[name] = -1
        np.save(file, rays)
    with pytest.raises(InputError, match="0% of the points"):
        observe(RecordedFrames(tmp_path))


def test_an_observation_tells_when_its_frames_were(tmp_path):
    write_recording(tmp_path / "rings")
    rows = [f"{number:04d}.npy,{number + (50.0 if number > 5 else 0.0)}" for number in range(8)]
    (tmp_path / "times.csv").write_text("\n".join(["frame,seconds", *rows]))
    found = ut.traffic.observe(
        tmp_path / "rings", tmp_path / "told", times=tmp_path / "times.csv", progress=False
    )
    told = json.loads((tmp_path / "told/observation.json").read_text())
    assert told["spacing"] == {"gaps": 1, "of_pairs": 7, "gap_after": ["0005"]}
    assert found.summary()["spacing"]["gaps"] == 1
    assert told["times_s"] == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 56.0, 57.0]
    assert told["groups"] == [0] * 6 + [1] * 2
    even = ut.traffic.observe(tmp_path / "rings", tmp_path / "even", rate=1.0, progress=False)
    assert "spacing" not in even.summary()
    assert (
        not {"spacing", "times_s"}
        & json.loads((tmp_path / "even/observation.json").read_text()).keys()
    )
    # Nobody is followed over the gap, and somebody is where there is none.
    for one, last, followed in ((found, 5.0, False), (even, 5.0, True)):
        tracks = pd.read_csv(one.folder / "tracks.csv")
        until = tracks.groupby("track_id")["time_s"].agg(["min", "max"])
        assert ((until["min"] <= last) & (until["max"] > last)).any() == followed
        assert tracks["time_s"].max() == (7.0 if followed else 57.0)


def test_things_are_told_by_their_shape():
    def upright(x, y, length, width, height, turn=0.0):
        """Four walls of a box in strips, as beams draw them."""
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * [length / 2, width / 2]
        corners = []
        for a, b in itertools.pairwise(ring):
            along = np.linspace(a, b, 12)
            for p, q in itertools.pairwise(along):
                for z in np.arange(0.15, height, 0.2):
                    low, high = z, min(z + 0.2, height)
                    corners += [
                        [[*p, low], [*q, low], [*q, high]],
                        [[*p, low], [*q, high], [*p, high]],
                    ]
        spun = np.array(corners)
        c, s = np.cos(turn), np.sin(turn)
        spun[..., :2] = spun[..., :2] @ [[c, s], [-s, c]]
        return spun + [x, y, 0.0]

    made = {
        "car": upright(10, 0, 4.4, 1.8, 1.5, 0.6),
        "pole": upright(0, 10, 0.2, 0.2, 4.0),
        "building": upright(-12, 0, 9.0, 6.0, 5.0),
        "other-object": upright(0, -8, 0.6, 0.5, 1.0),
        "vegetation": upright(15, 15, 3.0, 3.0, 2.5),
    }
    corner = np.concatenate(list(made.values()))
    name = np.repeat(list(made), [len(one) for one in made.values()])
    mesh = TriangleMesh(
        corner.reshape(-1, 3),
        np.arange(3 * len(corner), dtype=np.int32).reshape(-1, 3),
        None,
        (name == "vegetation").astype(np.int32),
        ("surface", "porous"),
    )
    lane = shapely.box(7, -3, 13, 3)
    found = standing_things(mesh, lane)
    assert found.counts == dict.fromkeys(sorted(made), 1)
    assert [semantic_id(one) for one in name] == found.semantic.tolist()
    assert (found.on_road == (name == "car")).all()
    assert not standing_things(mesh, shapely.Polygon()).on_road.any()

    # Two bumper to bumper, one whose flank alone was seen, and beside the carriageway the same.
    more = {
        "two": upright(30, 0, 9.2, 1.8, 1.5),
        "flank": upright(45, 1, 4.4, 0.02, 1.4),
        "hedge": upright(38, 3.4, 20.0, 1.0, 1.2),
        "post": upright(52, 0, 0.2, 0.2, 3.0),
        "crown": upright(25, 0, 3.0, 3.0, 2.0) + [0.0, 0.0, 2.5],
        "bonnet": upright(56, 0, 0.9, 0.6, 0.4) + [0.0, 0.0, 0.6],
        "sign": upright(58, -1, 0.6, 0.6, 0.6) + [0.0, 0.0, 2.2],
    }
    corner = np.concatenate(list(more.values()))
    index = np.arange(3 * len(corner), dtype=np.int32).reshape(-1, 3)
    mesh = TriangleMesh(corner.reshape(-1, 3), index, None, np.zeros(len(corner), np.int32), ("x",))
    street = shapely.box(20, -3.4, 60, 3.4)
    waits, count = waiting_parts(mesh, street, corner.mean(axis=1)[:, 2])
    name = np.repeat(list(more), [len(one) for one in more.values()])
    assert count == 3
    assert set(name[waits]) == {"two", "flank", "bonnet"}
    assert waits[np.isin(name, ["two", "flank", "bonnet"])].all()


def test_a_sector_in_which_nothing_ever_comes_back_is_blind(tmp_path):
    write_recording(tmp_path)
    rng = np.random.default_rng(1)
    for number in range(8):
        rays = np.load(tmp_path / "rays" / f"{number:04d}.npy")
        points = np.load(tmp_path / "points" / f"{number:04d}.npy")
        around = -rays["column"] % 360  # the columns run clockwise
        kept = (rays["sensor"] == 1) | ((around < 40) | (around >= 60)) & (
            rng.random(len(rays)) > 0.2
        )
        np.save(tmp_path / "rays" / f"{number:04d}.npy", rays[kept])
        np.save(tmp_path / "points" / f"{number:04d}.npy", points[kept])
    looks = Looks(RecordedFrames(tmp_path))
    counted = np.zeros((2, RINGS))
    for number in range(8):
        frame = looks.frames.read(number)
        np.add.at(counted, (frame.sensor, frame.ring), 1 / 8)
    blind, whole = (
        losses_of(beams, count, COLUMNS)
        for beams, count in zip(recorded_beams(looks), counted, strict=True)
    )
    assert [one[2] for one in blind.sectors] == [()]
    assert blind.sectors[0][:2] == pytest.approx((40, 60), abs=2.01)
    assert blind.missing == pytest.approx(0.2, abs=0.02)
    assert whole.written() == {}
