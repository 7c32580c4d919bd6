"""A turn in three moves between lanes that are too near for one sweep, in numbers."""

import numpy as np
import pytest

from urbantwin.roads import Lane
from urbantwin.traffic.events.lane_way import Way
from urbantwin.traffic.events.places import Spot
from urbantwin.traffic.events.u_turn import turn_in_three

R = 5.0


def spot(y: float, yaw: float) -> Spot:
    lane: Lane = None  # type: ignore[assignment]  # a turn asks for place and heading alone
    return Spot(lane, 0.0, np.array([0.0, y]), yaw)


@pytest.mark.parametrize("apart", [3.25, -3.25, 6.0])
def test_three_moves_lead_onto_the_lane_back_no_tighter_than_the_radius(apart: float) -> None:
    there = Way(np.array([[-40.0, 0.0], [-20.0, 0.0], [0.0, 0.0]]))
    away = Way(np.column_stack([np.linspace(10.0, -40.0, 101), np.full(101, apart)]))
    turn = turn_in_three(spot(0.0, 0.0), spot(apart, np.pi), R, there, away, 4.0)
    assert turn is not None
    assert (np.diff(turn.time_s) > 0).all()
    assert turn.moves[-1][1] == pytest.approx(apart, abs=1e-6)
    assert turn.xy[-1] == pytest.approx([-40.0, apart], abs=0.6)
    assert np.cos(turn.yaw[-1]) == pytest.approx(-1.0, abs=1e-6)
    # Nobody leaps, and nobody turns without moving: |turned| <= moved / R.
    moved = np.linalg.norm(np.diff(turn.xy, axis=0), axis=1)
    assert (moved / np.diff(turn.time_s)).max() < 4.2
    assert (np.abs(np.diff(turn.yaw)) <= moved / R * 1.02 + 1e-3).all()
    # One move goes backwards, half done at time 0; it covers what its angle says.
    ahead = np.column_stack([np.cos(turn.yaw), np.sin(turn.yaw)])
    forward = (np.diff(turn.xy, axis=0) * ahead[:-1]).sum(axis=1)
    backwards = forward < -1e-6
    assert (np.diff(np.flatnonzero(backwards)) == 1).all()
    second = np.arccos(np.cos(np.radians(75.0)) - 1.0 + abs(apart) / (2 * R))
    assert -forward[backwards].sum() == pytest.approx(R * (second - np.radians(75.0)), rel=0.02)
    lasting = turn.time_s[:-1][backwards]
    assert abs(lasting.mean()) < 0.15


def test_lanes_that_are_far_apart_need_no_three_moves() -> None:
    way = Way(np.array([[-40.0, 0.0], [0.0, 0.0]]))
    assert turn_in_three(spot(0.0, 0.0), spot(12.0, np.pi), R, way, way, 4.0) is None
