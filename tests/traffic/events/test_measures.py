"""Time to collision, post-encroachment time and gap against situations solved by hand."""

import numpy as np
import pytest

from urbantwin.traffic.events.measures import (
    Passage,
    conflict,
    gaps,
    post_encroachment,
    times_to_collision,
)


def straight(
    start: tuple[float, float],
    velocity: tuple[float, float],
    *,
    length: float = 4.0,
    width: float = 2.0,
    seconds: float = 20.0,
    from_s: float = 0.0,
) -> Passage:
    times = from_s + np.round(np.arange(0.0, seconds + 1e-9, 0.1), 9)
    xy = np.array(start) + (times - from_s)[:, None] * np.array(velocity)
    yaw = np.full(len(times), np.arctan2(velocity[1], velocity[0]))
    return Passage.along(times, xy, yaw, length, width)


@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2, 2.5])
def test_who_follows_faster_collides_after_gap_over_closing_speed(turn: float) -> None:
    c, s = np.cos(turn), np.sin(turn)
    ahead = straight((30 * c, 30 * s), (5 * c, 5 * s))
    behind = straight((0.0, 0.0), (9 * c, 9 * s))
    # 30 m between the middles, 26 m between the bumpers, 4 m/s.
    ttc = times_to_collision(behind, ahead)
    assert ttc[0] == pytest.approx(26 / 4)
    assert ttc[10] == pytest.approx(26 / 4 - 1.0)
    assert gaps(behind, ahead)[10] == pytest.approx(22.0)


def test_who_falls_back_never_collides() -> None:
    ttc = times_to_collision(straight((0, 0), (5, 0)), straight((30, 0), (9, 0)))
    assert np.isinf(ttc).all()


def test_ways_that_cross_at_right_angles() -> None:
    # Both fronts are 18 m from the other's near side: a's at 10 m/s, b's at 9 m/s.
    a, b = straight((-21, 0), (10, 0)), straight((0, -21), (0, 9))
    ttc = times_to_collision(a, b)
    # They touch when both shadows overlap: at the later of 18/10 and 18/9 s.
    assert ttc[0] == pytest.approx(18 / 9)
    # A third that is late by so much that the first is gone never touches it.
    late = straight((0, -60), (0, 9))
    assert np.isinf(times_to_collision(a, late)[0])


@pytest.mark.parametrize(("wait_m", "width"), [(10.0, 2.0), (25.0, 0.6), (40.0, 2.5)])
def test_post_encroachment_time_is_from_the_first_rear_to_the_second_front(
    wait_m: float, width: float
) -> None:
    v_a, v_b = 8.0, 6.0
    a = straight((-20, 0), (v_a, 0), width=width)
    b = straight((0, -20 - wait_m), (0, v_b))
    # The area is |x| < 1 (b's width) by |y| < width / 2. a's rear leaves it at x = 1.
    leaves = (20 + 1 + 2) / v_a
    comes = (20 + wait_m - width / 2 - 2) / v_b
    assert post_encroachment(a, b) == pytest.approx(comes - leaves, abs=0.025)
    assert post_encroachment(b, a) == pytest.approx(comes - leaves, abs=0.025)


def test_both_in_the_area_at_once_is_negative() -> None:
    found = post_encroachment(straight((-20, 0), (8, 0)), straight((0, -20), (0, 8)))
    assert found is not None
    assert found < 0


def test_ways_that_do_not_meet_have_no_post_encroachment_time() -> None:
    assert post_encroachment(straight((0, 0), (8, 0)), straight((0, 10), (8, 0))) is None


def test_the_least_over_time_is_told_with_its_moment() -> None:
    passing = conflict(straight((0, 0), (8, 0)), straight((160, 3.5), (-8, 0)))
    assert passing is not None
    assert passing.gap_m == pytest.approx(1.5)
    # Alongside from 156 m to 164 m of closing at 16 m/s.
    assert 156 / 16 - 0.11 <= passing.gap_at_s <= 164 / 16 + 0.11
    assert passing.ttc_s is None
    assert conflict(straight((0, 0), (1, 0)), straight((0, 9), (1, 0), from_s=30.0)) is None
