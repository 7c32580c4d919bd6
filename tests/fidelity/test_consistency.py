"""What is said of frames that do not belong together, on real frames that are spoilt here."""

import re
from dataclasses import replace

import numpy as np
import pytest

from urbantwin.fidelity.consistency import doubts_about
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.sensor_match import doubts_about_sensors
from urbantwin.geometry import Pose

from ..real_files import argoverse_log, ouster_scans
from ..thorough import further


@pytest.fixture(scope="module")
def sweeps(shared_data):
    """Return two consecutive real sweeps; the second has lost a sector of what stands."""
    log = argoverse_log(shared_data)
    real, later = open_recording(log)
    heading = np.degrees(np.arctan2(later.points[:, 1], later.points[:, 0]))
    lost = (heading > 40) & (heading < 110) & (later.points[:, 2] > 1.0)
    return real, later.only(~lost)


@pytest.fixture(scope="module")
def scans(shared_data):
    first, second, *_ = open_recording(ouster_scans(shared_data))
    return first, second


def spoilt(frame, change, **more):
    """Return a frame with other points, as plain clouds have them: nothing else is known."""
    return Frame(points=change(frame.points), **more)


def turned(degrees, shift=(0.0, 0.0, 0.0)):
    return Pose.from_ypr(shift, np.radians(degrees)).apply


def numbers(text):
    return [float(word) for word in re.findall(r"-?\d+\.?\d*", text)]


def test_nothing_is_said_of_honest_pairs(sweeps, scans):
    for real, other in (sweeps, scans):
        assert doubts_about(real, other) == []
        assert doubts_about(spoilt(real, lambda p: p), other) == []


@pytest.mark.parametrize("degrees", [-37, *further(90, 4)])
def test_a_turn_is_said_with_its_angle_and_what_undoes_it(sweeps, degrees):
    real, other = sweeps
    (said,) = doubts_about(spoilt(real, turned(degrees)), other)
    assert f"look rotated by {abs(degrees)} degrees" in said
    undone = next(n for n in numbers(said.split(":")[1]))
    assert (undone + degrees) % 360 == pytest.approx(0, abs=1)


@pytest.mark.thorough
def test_a_turn_with_a_shift_can_be_undone_as_it_says(scans):
    real, other = scans
    (said,) = doubts_about(spoilt(real, turned(-128, (6.0, -3.0, 0.0))), other)
    turn, x, y = numbers(said.split(":")[1])
    # Turned back about the origin, then shifted: the way the sentence says it.
    moved = turned(turn, (x, y, 0.0))(turned(-128, (6.0, -3.0, 0.0))(real.points))
    assert np.abs(moved - real.points).mean() < 0.5


@pytest.mark.thorough
def test_shifts(sweeps):
    real, other = sweeps
    (said,) = doubts_about(spoilt(real, lambda p: p + [2.0, -3.0, 0.0]), other)
    assert numbers(said)[:2] == pytest.approx([2.0, -3.0], abs=0.2)
    (said,) = doubts_about(spoilt(real, lambda p: p + [0.0, 0.0, 1.7]), other)
    assert "1.7 m higher" in said
    (first, second) = doubts_about(spoilt(real, lambda p: p + [583710.0, 4477260.0, -0.9]), other)
    assert "shifted by 583710" in first
    assert "0.9 m lower" in second


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1, -1, 1]), "mirrored (y turned round)"),
        (np.eye(3) / 0.3048, "in feet"),
        (Pose.from_ypr([0, 0, 0], 0.0, np.radians(6)).rotation, "tilted by 6 degrees"),
        *further(
            ([[0, -1, 0], [0, 0, -1], [1, 0, 0]], "take x = z, y = -x, z = -y"),
            (np.eye(3)[[1, 0, 2]], "mirrored (x and y exchanged)"),
            (np.diag([1, -1, -1]), "take x = x, y = -y, z = -z"),
            (np.eye(3) * 1000, "in millimetres"),
        ),
    ],
)
def test_other_axes_units_and_tilts(scans, matrix, words):
    real, other = scans
    (said,) = doubts_about(spoilt(real, lambda p: p @ np.asarray(matrix, float).T), other)
    assert words in said


def test_a_single_wall_tells_a_turn_too():
    """A wall beside a street fits in many places, but only after one turn about the sensor."""
    rng = np.random.default_rng(3)
    street = rng.uniform([-25, -25, -4], [25, 25, -4], (2500, 3))
    wall = rng.uniform([-10, 12, -4], [20, 12, 4], (1500, 3))
    points = np.concatenate([street, wall])
    again = Frame(points=points + rng.normal(scale=0.02, size=points.shape))
    assert doubts_about(Frame(points=points), again) == []
    (said,) = doubts_about(Frame(points=turned(90)(points)), again)
    assert "look rotated by 90 degrees" in said


@pytest.mark.thorough
def test_another_place_is_not_called_a_turn(sweeps, scans):
    (said,) = doubts_about(sweeps[0], scans[0])
    assert "different places" in said


def test_another_sensor(scans):
    real, other = scans
    (said,) = doubts_about(real.only(real.ring % 2 == 0), other)
    rings, its = re.search(r"by (\d+) rings of the real frames and by (\d+) of", said).groups()
    assert 2 * int(rings) == pytest.approx(int(its), rel=0.1)
    (said,) = doubts_about(real.only(real.column % 2 == 0), other)
    step, its = numbers(said)[:2]
    assert step == pytest.approx(2 * its, rel=0.1)
    near = np.linalg.norm(real.points, axis=1) < 25
    (said,) = doubts_about(real.only(near), other)
    assert "end sharply at 25 m" in said
    (said,) = doubts_about(real.only(real.ring < 105), other)  # of 128, from the top
    assert "lowest beams" in said
    # Without rings, by how dense the same ground is.
    thin = Frame(points=real.points[::4], intensity=None)
    (said,) = doubts_about(thin, other)
    assert numbers(said)[0] == pytest.approx(0.25, abs=0.05)


@pytest.mark.thorough
def test_a_twin_without_houses_is_no_other_sensor(sweeps):
    """Seen from the origin of the vehicle, where no sensor is: rings are no cones there."""
    real, other = (
        replace(one, sensor_places=np.zeros((1, 3)), sensor=None, ring=one.ring + 32 * one.sensor)
        for one in sweeps
    )
    bare = other.only(other.points[:, 2] < 0.4)
    assert doubts_about(real, bare) == []
    half = real.only(real.ring % 2 == 0)
    assert any("rings of the real frames" in said for said in doubts_about(half, bare))


@pytest.mark.parametrize(("shown", "said"), [([0, 2, 3, 5, 6, 8], False), ([0, 2, 5, 8], True)])
def test_a_few_rings_that_cars_hide_are_no_other_sensor(shown, said):
    """A level plane seen 5 to 11 m away by nine rings of a sensor, of which some are hidden."""
    down, turn = np.meshgrid(np.radians(np.linspace(20, 38, 9)), np.radians(np.arange(0, 360, 0.4)))
    away = 4.0 / np.tan(down)
    points = np.column_stack(
        [(away * np.cos(turn)).ravel(), (away * np.sin(turn)).ravel(), np.full(turn.size, -4.0)]
    )
    ring = np.broadcast_to(np.arange(9), turn.shape).ravel()
    generator = np.random.default_rng(0)
    some, whole = (
        Frame(points=points + generator.normal(0, 0.01, points.shape), ring=ring) for _ in range(2)
    )
    found = doubts_about_sensors(some.only(np.isin(some.ring, shown)), whole)
    assert any("rings of the real" in one for one in found) == said


def test_nothing_is_said_of_hardly_any_points():
    one = Frame(points=np.array([[1.0, 2.0, 3.0]]))
    flat = Frame(points=np.random.default_rng(0).uniform([-9, -9, 0], [9, 9, 0], (500, 3)))
    for a in (one, flat):
        for b in (one, flat):
            assert doubts_about(a, b) == []
    same = Frame(points=np.tile([[5.0, 5.0, 5.0]], (300, 1)))
    doubts_about(same, flat)  # neither warns nor fails
