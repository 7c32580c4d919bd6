"""Beams, background and objects of frames whose answers are known."""

import numpy as np
import pytest

from urbantwin.fidelity.background_subtraction import Background
from urbantwin.fidelity.beams import beam_agreement, beams_are_known
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.object_statistics import ObjectStatistics, object_differences


def turn(distance, *, columns=True, place=(0.0, 0.0, 0.0)):
    """Return a frame of 4 rings and 90 columns whose beams have the ranges (4, 90), NaN: none."""
    ring, column = np.indices(distance.shape)
    azimuth, elevation = np.radians(column * 4 + 0.1), np.radians(ring * 5 - 10)
    way = np.stack(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ],
        axis=-1,
    )
    some = np.isfinite(distance)
    return Frame(
        (way * distance[..., None])[some] + place,
        ring=ring[some],
        column=column[some] if columns else None,
        sensor_places=np.array([place]),
    )


@pytest.mark.parametrize("columns", [True, False])
def test_beams_are_matched_and_outcomes_counted(columns):
    rng = np.random.default_rng(0)
    real = rng.uniform(5, 50, (4, 90))
    twin = real + 0.25
    twin[0] += 0.5  # a quarter of the beams is 0.75 m too far
    real[1, :30] = np.nan  # 30 only in the twin
    twin[2, 10:20] = np.nan  # 10 only in reality
    real[3, 5] = twin[3, 5] = np.nan  # 1 in neither
    place = (3.0, -2.0, 4.0)
    found = beam_agreement(turn(real, place=place), turn(twin, columns=columns, place=place))
    assert beams_are_known(turn(real), turn(twin, columns=columns)) == (
        "column" if columns else "azimuth"
    )
    assert found.beams == 360
    assert found.matched == 360 - 41
    assert found.range_error_median_m == pytest.approx(0.25)
    assert found.range_error_abs_p95_m == pytest.approx(0.75)
    assert found.same_outcome == pytest.approx(320 / 360)
    assert found.real_dropout == pytest.approx(31 / 360)
    assert found.synthetic_dropout == pytest.approx(11 / 360)


def test_unknown_beams_are_not_compared():
    frame = turn(np.full((4, 90), 9.0))
    assert beam_agreement(frame, Frame(frame.points)) is None
    # Another sensor, of more rings.
    assert beam_agreement(frame, turn(np.full((5, 90), 9.0))) is None
    # Columns of another rate: only the azimuth is common.
    assert beams_are_known(frame, turn(np.full((4, 80), 9.0))) == "azimuth"


def test_the_background_stays_and_what_drives_is_foreground():
    rng = np.random.default_rng(1)
    wall = np.column_stack([rng.uniform(-10, 10, (4000, 1)), np.full(4000, 8.0)])
    wall = np.column_stack([wall, rng.uniform(0, 4, 4000)])
    car = rng.uniform([-2, -1, 0], [2, 1, 1.5], (300, 3))

    def frame(index):
        noise = rng.normal(scale=0.02, size=wall.shape)
        return np.concatenate([wall + noise, car + [-20 + 5.0 * index, 0, 0]])

    background = Background(Frame(frame(index)) for index in range(8))
    moving = background.foreground(Frame(frame(3)))
    assert moving[4000:].all()
    assert moving[:4000].mean() < 0.01
    with pytest.raises(ValueError, match="at least"):
        Background([Frame(wall)] * 4)


def labelled(shift, length, per_car, name="car"):
    rng = np.random.default_rng(0)
    box = np.array(
        [[10.0 + shift, 0, 0.75, length, 1.8, 1.5, 0.3], [25.0, 5 + shift, 0.9, 0.6, 0.6, 1.8, 0]]
    )
    car = rng.uniform(-0.5, 0.5, (per_car, 3)) + box[0, :3]
    person = rng.uniform(-0.2, 0.2, (20, 3)) + box[1, :3]
    boxes = Boxes(box, (name, "pedestrian"), np.array([1, 2]))
    return Frame(np.concatenate([car, person, rng.uniform(50, 60, (40, 3))]), boxes=boxes)


def test_objects_and_their_differences():
    real = ObjectStatistics.of([labelled(0, 4.4, 99), Frame(np.ones((1, 3)))])
    told = real.as_json()
    assert told["frames"] == 1
    assert told["classes"]["car"]["dimensions"]["length_m"]["mean"] == pytest.approx(4.4)
    assert told["heat_map"]["x_y_boxes"] == [[10, 0, 1], [24, 4, 1]]
    assert told["classes"]["car"]["points_per_box"][0]["median"] == 99
    assert told["classes"]["car"]["points_per_box"][0]["from_m"] == 10
    assert told["classes"]["pedestrian"]["points_per_box"][0]["median"] == 20

    found = object_differences(real, ObjectStatistics.of([labelled(0, 4.9, 199)]))
    assert found["class_mix_js"] == 0
    assert found["heat_map_js"] == 0
    assert found["classes"]["car"]["dimensions"]["length_m"] == pytest.approx(0.5)
    assert found["classes"]["car"]["points_ratio"] == pytest.approx(2)
    assert found["boxes_per_frame_ratio"] == 1

    # One class of two in common; all boxes elsewhere.
    other = object_differences(real, ObjectStatistics.of([labelled(4, 4.4, 99, "bus")]))
    assert other["class_mix_js"] == pytest.approx(0.5)
    assert other["heat_map_js"] == pytest.approx(1)
    assert set(other["classes"]) == {"pedestrian"}

    nothing = object_differences(real, ObjectStatistics())
    assert nothing["class_mix_js"] is None
    assert nothing["boxes_per_frame_ratio"] is None
