"""Both VLP-32C of Argoverse 2 where they were, simulated, beside what they really saw."""

import numpy as np
import pytest

from ..real_cases.argoverse_pair import measure

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def result(shared_data):
    return measure(shared_data / "lidar" / "argoverse2-pittsburgh")


def test_the_catalogues_beams_and_firing_times_are_those_of_the_real_sensors(result):
    assert result["catalogue"]["elevation_deg"] < 0.01
    assert result["catalogue"]["azimuth_p95_deg"] < 0.03
    assert result["catalogue"]["firing_time_us"] < 1.0


def test_ranges_on_the_ground_differ_about_as_much_as_from_turn_to_turn(result):
    ground, again = result["ground"], result["ground_real_against_real"]
    assert ground["rays"] > 20_000
    assert abs(ground["median_m"]) < 0.10
    assert ground["sigma_m"] < 1.5 * again["sigma_m"]


def test_every_beam_meets_the_ground_at_its_height(result):
    rows = result["ground_per_beam"]
    assert len(rows) >= 18
    assert max(abs(row["height_m"]) for row in rows) < 0.08  # the map counts in 6.25 cm
    near = [row["median_m"] for row in rows if row["range_m"] < 13]
    assert np.abs(near).max() < 0.2


def test_boxes_hold_about_as_many_points_as_really(result):
    for sweep in result["boxes"]:
        assert sweep["boxes"] >= 29
        assert 0.8 < sweep["median"] < 1.25


def test_asphalt_is_about_as_bright(result):
    near = [row for row in result["intensity_ground"] if row["to_m"] <= 30]
    assert len(near) == 4
    for row in near:
        assert abs(row["real"] - row["simulated"]) <= 2.0  # of 100
