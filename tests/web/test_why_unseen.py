"""Which objects are named as hiding another, in plan and by hand."""

import numpy as np
import pytest

from urbantwin.web.shown_boxes import ShownBoxes
from urbantwin.web.why_unseen import explain_unseen

SENSOR = np.array([[0.0, 0.0, 1.0]])


def shown(*boxes, alone=50):
    """Boxes of 2 m at places (x, y) with points; tracks are 1, 2, ...; the first is turned."""
    rows = np.array([(x, y, 1.0, 2.0, 2.0, 2.0, 0.0) for x, y, _ in boxes])
    rows[0, 6] = np.pi / 4
    return ShownBoxes(
        rows,
        ["car"] * len(boxes),
        np.arange(1, len(boxes) + 1),
        points=np.array([points for _, _, points in boxes]),
        alone=np.full(len(boxes), alone),
    )


@pytest.mark.parametrize(
    ("others", "tracks", "words"),
    [
        ([(10, 0, 99)], [2], "car 2 stands before it"),
        ([(10, 0, 99), (15, 0, 0)], [2], "car 2 stands before it"),  # The second ends no line.
        ([(10, 1, 99), (10, -1, 99)], [2, 3], "car 2 and car 3 stand before it"),
        ([(25, 0, 99)], [], "others stand before it"),  # Behind it.
        ([(10, 6, 99)], [], "others stand before it"),  # Beside the lines.
    ],
)
def test_the_object_that_ends_lines_of_sight_is_named(others, tracks, words):
    boxes = shown((20, 0, 1), *others)
    explain_unseen(boxes, SENSOR, 100.0)
    assert sorted(boxes.hidden_by[0]) == tracks
    assert boxes.why[0] == f"It has 1 point and would have 50 alone: {words}."
    assert boxes.why[1] == ""


def test_far_outside_and_empty():
    boxes = shown((200, 0, 0))
    explain_unseen(boxes, SENSOR, 100.0)
    assert "200 m away, and the sensor sees 100 m far" in boxes.why[0]
    boxes = shown((20, 0, 0), (10, 0, 99))
    boxes.ignored = ["outside", ""]
    explain_unseen(boxes, SENSOR, 100.0)
    assert "outside of the region" in boxes.why[0]
    boxes = shown((20, 0, 0), alone=0)
    explain_unseen(boxes, SENSOR, 100.0)
    assert "would have none alone" in boxes.why[0]
    nothing = ShownBoxes.of(None)
    explain_unseen(nothing, SENSOR, 100.0)
    assert nothing.why == []
