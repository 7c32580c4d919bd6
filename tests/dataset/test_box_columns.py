"""Boxes as text and as columns."""

import json
import math
from decimal import ROUND_HALF_EVEN, Decimal

import numpy as np

from urbantwin.dataset.box_columns import box_columns, box_rows, label_lines, packed_columns
from urbantwin.lidar import BoxLabel


def boxes(count: int = 200) -> list[BoxLabel]:
    draw = np.random.default_rng(5)
    made = []
    for number in range(count):
        box = draw.normal(0, 40, 7) * draw.choice([1.0, 1e-6])
        alone = int(draw.integers(0, 3)) * 7
        made.append(
            BoxLabel(number + 1, "car", box, min(alone, 5), alone, draw.normal(0, 5, 3), 0.01)
        )
    return made


def test_a_line_has_four_decimals_of_each_number_and_no_negative_zero() -> None:
    """Against exact decimal arithmetic."""
    for one, line in zip(boxes(), label_lines(boxes()).splitlines(), strict=True):
        *numbers, name = line.split(" ")
        turn = (one.box[6] + math.pi) % math.tau - math.pi
        for value, text in zip([*one.box[:6], turn], numbers, strict=True):
            exact = Decimal(float(value)).quantize(Decimal("0.0001"), ROUND_HALF_EVEN)
            assert text == f"{exact if exact else abs(exact)}"
        assert name == one.actor_class
    assert "-0.0000" not in label_lines(boxes())


def test_columns_come_back_from_json_as_they_were() -> None:
    made = boxes()
    rows = box_rows(packed_columns(json.loads(json.dumps(box_columns(made), allow_nan=False))))
    for one, row in zip(made, rows, strict=True):
        assert (row["track"], row["class"]) == (one.track, one.actor_class)
        assert [row[name] for name in ("x", "height")] == [one.box[0], one.box[5]]
        assert -math.pi <= row["yaw"] < math.pi
        assert math.isclose(math.sin(row["yaw"]), math.sin(one.box[6]), abs_tol=1e-12)
        assert [row[name] for name in ("vx", "vy", "vz")] == one.velocity.tolist()
        unknown = one.num_points_alone == 0
        assert row["occlusion"] == (None if unknown else one.occlusion)
        assert row["visibility"] == (None if unknown else one.visibility)
        assert (row["difficulty"], row["ignored"]) == (one.difficulty, one.ignored)


def test_no_boxes_are_no_lines_and_empty_columns() -> None:
    assert label_lines([]) == ""
    assert box_rows(packed_columns(box_columns([]))) == []
