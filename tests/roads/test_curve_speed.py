"""Speeds on curves against the physics of a circle, of braking and of a lane change."""

import numpy as np
import pytest
from lxml import etree

from urbantwin.roads.curve_speed import BRAKING_MS2, SIDEWAYS_MS2, curve_speeds, lane_speeds


@pytest.mark.parametrize("radius", [7.0, 12.0, 30.0, 80.0, 300.0])
def test_on_a_circle_the_acceleration_to_the_side_is_what_drivers_accept(radius: float) -> None:
    angle = np.linspace(0.0, 60.0 / radius, 500)
    line = radius * np.column_stack([np.sin(angle), 1 - np.cos(angle)])
    middle = curve_speeds(line)[20:40]
    np.testing.assert_allclose(middle**2 / radius, SIDEWAYS_MS2, rtol=0.05)


def test_who_drives_as_allowed_brakes_gently_before_a_bend() -> None:
    angle = np.linspace(0.0, np.pi / 2, 60)
    bend = np.column_stack([100 + 10 * np.sin(angle), 10 - 10 * np.cos(angle)])
    speed = curve_speeds(np.vstack([[0.0, 0.0], bend, [110.0, 200.0]]))
    slowing = -np.diff(speed**2) / 2  # over metres
    assert slowing[:90].max() == pytest.approx(BRAKING_MS2, rel=1e-6)
    assert speed[104:112].max() < 1.05 * np.sqrt(SIDEWAYS_MS2 * 10)
    assert speed[0] > 18.0
    assert speed[160] > 18.0


def test_a_straight_line_allows_any_speed_and_a_turn_on_the_spot_hardly_any() -> None:
    assert curve_speeds(np.array([[0.0, 0.0], [200.0, 0.0]])).min() > 40.0
    back = curve_speeds(np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 0.5], [0.0, 0.5]]))
    assert 1.0 < back.min() < 3.0


def test_a_corner_between_two_lanes_slows_down_on_the_way_between_them() -> None:
    """Neither lane bends, and the way over the junction is a straight cut across the corner."""
    network = etree.fromstring(
        """<net>
        <edge id="a"><lane id="a_0" length="100" speed="14" shape="-100,0 0,0"/></edge>
        <edge id=":j_0" function="internal">
          <lane id=":j_0_0" length="8.49" speed="14" shape="0,0 6,6"/></edge>
        <edge id="b"><lane id="b_0" length="100" speed="14" shape="6,6 6,106"/></edge>
        <connection from="a" to="b" fromLane="0" toLane="0" via=":j_0_0" dir="l"/>
        <connection from=":j_0" to="b" fromLane="0" toLane="0" dir="l"/></net>"""
    )
    speeds = lane_speeds(network)
    assert speeds["a_0"].min() > 20.0
    # A quarter turn over about 8 m: a circle of 5 to 8 m radius.
    assert np.sqrt(SIDEWAYS_MS2 * 4) < speeds[":j_0_0"].min() < np.sqrt(SIDEWAYS_MS2 * 8.5)


def test_speeds_are_by_the_length_that_sumo_says() -> None:
    """A half circle of 63 m that is 50 m long in SUMO: the speed over ground is what counts."""
    angle = np.linspace(0, np.pi, 100)
    shape = " ".join(f"{20 * np.sin(t):.3f},{-20 * np.cos(t):.3f}" for t in angle)
    network = etree.fromstring(
        f'<net><edge id="a"><lane id="a_0" length="50" speed="14" shape="{shape}"/></edge></net>'
    )
    speed = lane_speeds(network)["a_0"]
    assert len(speed) in (51, 52)
    over_ground = speed[10:40] * np.pi * 20 / 50
    np.testing.assert_allclose(over_ground**2 / 20, SIDEWAYS_MS2, rtol=0.05)
