"""Posts that a detector takes for people are told by frames of another hour."""

import numpy as np
import pytest

from urbantwin.detections import joined, standing_places, without_standing
from urbantwin.errors import InputError

FRAMES = 20
#: A post, a parked car, and where somebody walks from, metres.
POST, PARKED, WALK = (10.0, -4.0), (3.0, 8.0), (-15.0, 2.0)


def hour(seed, *, post=0.7, frames=FRAMES):
    """Return detections of a post in a share of the frames, a parked car, and a walker."""
    draw = np.random.default_rng(seed)
    found = []
    for number in range(frames):
        there = [(PARKED, "car", 0.9), ((WALK[0] + 1.2 * number, WALK[1]), "pedestrian", 0.8)]
        if draw.random() < post:  # now a person, now a bicycle
            there.append((POST, draw.choice(["pedestrian", "bicycle"]), 0.6))
        boxes = np.zeros((len(there), 7))
        boxes[:, :2] = [place for place, _, _ in there] + draw.normal(0, 0.05, (len(there), 2))
        boxes[:, 3:6] = 0.6, 0.6, 1.7
        found.append((boxes, [name for _, name, _ in there], np.array([s for *_, s in there])))
    return joined([f"{number:04}" for number in range(frames)], found)


def test_a_post_goes_and_all_else_stays():
    places = standing_places(hour(1))
    np.testing.assert_allclose(places, np.tile(POST, (len(places), 1)), atol=0.3)
    later = hour(2)
    left = without_standing(later, places)
    at_post = np.hypot(*(later.box[:, :2] - POST).T) < 1.0
    assert at_post.any()
    assert list(left.class_names) == [
        name for name, gone in zip(later.class_names, at_post, strict=True) if not gone
    ]
    assert left.frames == later.frames


def test_what_is_rarely_found_is_not_of_the_site():
    assert len(standing_places(hour(3, post=0.3))) == 0
    later = hour(4)
    assert without_standing(later, np.zeros((0, 2))) is later


def test_who_passes_a_post_is_lost_only_beside_it():
    """The walker's way leads past the post at 0.6 m: he is kept."""
    places = np.array([[WALK[0] + 12.0, WALK[1] + 0.6]])
    left = without_standing(hour(5, post=0.0), places)
    assert left.class_names.count("pedestrian") == FRAMES


def test_few_frames_do_not_tell(tmp_path):
    with pytest.raises(InputError, match=r"9 frames .*; expected at least 10"):
        standing_places(hour(6, frames=9), tmp_path)
