"""What a dataset warns of."""

from typing import Any

from urbantwin.dataset.box_columns import packed_columns
from urbantwin.dataset.result_warnings import warnings_of_record
from urbantwin.result_warning import ResultWarning
from urbantwin.traffic.result_warnings import PAST_SENSORS


def boxes(
    kind: str, points: list[int], ignored: str | None = None, alone: int = 9
) -> list[dict[str, Any]]:
    return [
        {
            "class": kind,
            "track": track,
            "num_points": count,
            "num_points_alone": alone,
            "ignored": ignored,
        }
        for track, count in enumerate(points)
    ]


def frame(*groups: list[dict[str, Any]], points: int = 1000) -> dict[str, Any]:
    rows = [box for group in groups for box in group]
    columns = {name: [box[name] for box in rows] for name in rows[0]}
    return {"points": points, "boxes": packed_columns(columns)}


def test_classes_of_which_most_have_no_points_are_told() -> None:
    seen, hidden = boxes("car", [5] * 30), boxes("pedestrian", [9] * 10 + [0] * 30)
    (warning,) = warnings_of_record([frame(seen, hidden)])
    assert warning.about == "objects"
    assert warning.problem.endswith("few have points: 25% of pedestrian boxes")
    assert "behind something" in warning.reason
    one = [{**box, "track": 1} for box in boxes("truck", [0] * 50)]
    assert not [*warnings_of_record([frame(seen, one)])]
    far = boxes("pedestrian", [0] * 30, alone=0)
    (warning,) = warnings_of_record([frame(far, boxes("bus", [0] * 20, alone=0))])
    assert "0% of bus boxes, 0% of pedestrian boxes" in warning.problem
    assert "too far away" in warning.reason
    assert not [*warnings_of_record([frame(seen, boxes("pedestrian", [9] * 20 + [0] * 20))])]


def test_what_no_sensor_is_meant_to_see_is_not_told() -> None:
    beyond = [*boxes("car", [0] * 50, "outside"), *boxes("car", [0] * 50, "far")]
    assert not [*warnings_of_record([frame(beyond, boxes("car", [5]))])]
    (warning,) = warnings_of_record([frame(beyond)])
    assert warning.problem.startswith("no actor is ever within the region")


def test_a_junction_without_traffic_is_told_first_and_range_is_not_blamed() -> None:
    empty = ResultWarning(PAST_SENSORS, "no motor vehicle comes within 50 m", "", "look there")
    far = boxes("car", [0] * 30, alone=0)
    first, second = warnings_of_record([frame(far)], [ResultWarning("traffic", "x"), empty])
    assert first == empty
    assert "no motor vehicle comes within 50 m" in second.reason
    assert "too far away" not in second.reason


def test_frames_without_points_are_told() -> None:
    car = boxes("car", [5])
    (warning,) = warnings_of_record([frame(car), frame(car, points=0)])
    assert warning.problem == "1 of 2 frames have none"
