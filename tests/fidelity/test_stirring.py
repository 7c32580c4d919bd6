"""What stirs before a sensor that stands still: measured from frames, and recorded again."""

from dataclasses import replace

import numpy as np
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.background_estimation import measured_backgrounds
from urbantwin.fidelity.background_subtraction import Background
from urbantwin.fidelity.beam_assignment import BeamsOf
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Scanner, place_rig, sensor
from urbantwin.lidar.background_file import load_backgrounds, save_backgrounds, with_background
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import material_id, semantic_id

COLUMNS, WALL_M, FRAMES = 900, 20.0, 16


def vlp16():
    return BeamsOf("", sensor("VLP-16"), COLUMNS, 10.0, Pose.from_ypr(np.zeros(3)))


def bush(frames=FRAMES, seed=0):
    """Return frames of a wall all around and, before a sixth of it, a bush.

    In each frame half of the bush's parts of 6 degrees let all rays through, and in the others
    every leaf is in another place.
    """
    rng, one = np.random.default_rng(seed), vlp16()
    aim = one.directions.reshape(-1, 3)
    part = (np.arange(len(aim)) % COLUMNS) // 15
    found = []
    for _ in range(frames):
        far = np.full(len(aim), WALL_M)
        grown = (part < 10) & (rng.random(60) < 0.5)[part]
        far[grown] = rng.uniform(5.0, 12.0, grown.sum())
        found.append(Frame(aim * far[:, None]))
    return found, part < 10


@pytest.fixture(scope="module")
def measured():
    frames, leaves = bush()
    (found,) = measured_backgrounds(frames, [vlp16()])
    return found, leaves


def test_a_bush_is_what_stirs_and_its_beams_see_it_as_often_as_they_did(measured):
    found, leaves = measured
    stirring = found.stirring
    assert leaves[stirring.beam].all()
    assert len(stirring.beam) > 0.9 * leaves.sum()
    met = stirring.range_m > 0
    assert met.mean() == pytest.approx(0.5, abs=0.08)
    assert 5 <= stirring.range_m[met].min() < stirring.range_m.max() <= 12
    # The wall behind it is seen by all looks that the bush lets through.
    assert np.median(found.share[0].ravel()[stirring.beam]) == pytest.approx(1.0, abs=0.01)
    # Frames are independent: nothing lasts.
    assert stirring.lasts_s == pytest.approx(0.1, rel=0.2)


def test_what_drives_through_or_waits_does_not_stir():
    """A wide vehicle in front for five frames in succession; another one drives past."""
    one = vlp16()
    aim = one.directions.reshape(-1, 3)
    column = np.arange(len(aim)) % COLUMNS
    rng, frames = np.random.default_rng(1), []
    for number in range(FRAMES):
        far = WALL_M + rng.normal(0, 0.02, len(aim))
        far[(column < 60) & (4 <= number < 13)] = 7.0 + 0.03 * number
        far[(column // 40 == number + 3)] = 9.0
        frames.append(Frame(aim * far[:, None]))
    (found,) = measured_backgrounds(frames, [one])
    assert found.stirring is None


def recorded(background, numbers):
    """Return the ranges (F, N) that a sensor before this background records; 0: none."""
    level = LabelledMesh.build(
        [[-60, -60, -9], [60, -60, -9], [60, 60, -9], [-60, 60, -9]],
        [[0, 1, 2], [0, 2, 3]],
        semantic_id("road"),
        material_id("asphalt"),
    )
    mounted = {"name": "a", "model": "VLP-16", "columns": COLUMNS, "east_m": 0, "north_m": 0}
    rig = RigSpec.model_validate({"frame": "sensor", "sensors": [{**mounted, "height_m": 9}]})
    scanner = Scanner(level, with_background(place_rig(rig, level), background), 3)
    far = np.zeros((len(numbers), 16 * COLUMNS))
    for row, number in zip(far, numbers, strict=True):
        seen = scanner.scan(number, [])
        beam = seen.ring.astype(int) * COLUMNS + seen.column
        row[beam] = np.linalg.norm(seen.points[:, :3], axis=1)
    return far


def test_recorded_again_a_bush_stirs_as_it_did_part_by_part(measured, tmp_path):
    """Beams side by side come and go together, as measured; parts of it do not."""
    save_backgrounds(tmp_path / "a.npz", [measured[0]])
    (background,) = load_backgrounds(tmp_path / "a.npz")
    background = replace(background, turns_per_second=float("nan"))
    leaves = measured[1]
    # A turn lasts as long as what stirs does.
    far = recorded(background, range(0, 24, 2))
    stirs = (far > 0) & (far < WALL_M - 2)
    assert not stirs[:, ~leaves].any()
    assert stirs[:, leaves].mean() == pytest.approx(0.5, abs=0.1)
    beside = stirs[:, leaves].reshape(len(far), 16, 150)
    together, apart = (
        np.corrcoef(beside[:, :, 34:110:15].ravel(), beside[:, :, 34 + n : 110 + n : 15].ravel())
        for n in (2, 40)
    )
    assert together[0, 1] > 0.5
    assert abs(apart[0, 1]) < 0.3
    # The same numbers whatever was recorded before.
    np.testing.assert_array_equal(recorded(background, [6])[0], far[3])
    (still,) = recorded(replace(background, stirring=None), [0])
    assert (still[~leaves] > WALL_M - 1).all()


def test_what_stirs_for_long_stays_for_so_long(measured):
    slow = replace(measured[0].stirring, lasts_s=1e4)
    background = replace(measured[0], stirring=slow)
    leaf = slow.beam
    first, second = recorded(background, [0, 5])[:, leaf]
    same = (first < 12) == (second < 12)
    assert same.mean() > 0.9


def test_a_file_whose_stirring_is_damaged_is_told_in_a_line(measured, tmp_path):
    background = measured[0]
    for name, value, told in (
        ("beam", background.stirring.beam[::-1].copy(), "ascending"),
        ("beam", background.stirring.beam + 16 * COLUMNS, "to 14399"),
        ("range_m", -background.stirring.range_m, r"range_m.*: has the value"),
        ("patch", background.stirring.patch[1:], "is of shape"),
    ):
        broken = replace(background.stirring, **{name: value})
        save_backgrounds(tmp_path / "a.npz", [replace(background, stirring=broken)])
        with pytest.raises(InputError, match=told):
            load_backgrounds(tmp_path / "a.npz")


def test_fused_frames_find_beams_by_the_rings_of_their_own_sensor():
    """Two units side by side whose rings lie 0.3 degrees off the model's, and points of neither."""
    model = sensor("VLP-16")
    ring = np.repeat(np.arange(16), 1800)
    units, points, rings, numbers = [], [], [], []
    for number in range(2):
        pose = Pose.from_ypr(np.array([4.0 * number, 0, 0]))
        units.append(BeamsOf("", model, 1800, 10.0, pose, number=number))
        aim = units[-1].directions.reshape(-1, 3)
        up = np.arcsin(aim[:, 2]) + np.radians(0.3) * np.cos(ring)
        around = np.arctan2(aim[:, 1], aim[:, 0])
        level = np.column_stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up)])
        points.append(pose.apply(np.column_stack([level, np.sin(up)]) * 12.0))
        rings.append(ring)
        numbers.append(np.full(len(aim), number))
    lost = np.array([[3.0, 3.0, 0.5]])
    frame = Frame(
        np.concatenate([*points, lost]),
        ring=np.concatenate([*rings, [-1]]),
        sensor=np.concatenate([*numbers, [-1]]),
    )
    for one in units:
        _, beam, _ = one.of(frame)
        assert len(beam) == one.count


def test_points_without_a_ring_move_where_those_beside_them_do():
    """A car that passes and a twig that always stands, each with points of no ring."""
    one = vlp16()
    aim = one.directions.reshape(-1, 3)
    ring, column = np.divmod(np.arange(len(aim)), COLUMNS)
    frames = []
    for number in range(FRAMES):
        far = np.full(len(aim), WALL_M)
        far[column // 30 == number + 2] = 10.0
        points = aim * far[:, None]
        passing = points[column // 30 == number + 2].mean(axis=0)
        twig = aim[600] * 15.0 + [[0, 0, 0.0], [0, 0, 0.1], [0, 0, 0.2]]
        lost = np.vstack([passing, twig])
        frames.append(
            Frame(
                np.vstack([points, lost]),
                ring=np.append(ring, np.full(len(lost), -1)),
                column=np.append(column, np.full(len(lost), -1)),
            )
        )
    model = Background(frames)
    moves = model.foreground(frames[3])
    np.testing.assert_array_equal(moves[-4:], [True, False, False, False])
