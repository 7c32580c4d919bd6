"""Reasons why objects are missed, of cases that are made for them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from urbantwin.detections import Detections
from urbantwin.evaluation import Criterion, Seen, Truth
from urbantwin.evaluation.criterion import JUDGED, near, overlapping
from urbantwin.evaluation.pairs import pairs_of
from urbantwin.evaluation.truth import why_not
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers import Recording
from urbantwin.studies.causes import Side, changes_between, thresholds_of

CAR, CYCLE = (4.5, 1.8, 1.5), (1.8, 0.6, 1.7)
LEAST = {"car": 0.4, "truck": 0.4, "bicycle": 0.4}
BY_DISTANCE = {name: near(name) for name in JUDGED}
BY_OVERLAP = dict.fromkeys(JUDGED, overlapping())


def unread(index: int) -> Frame:
    """Only the layout of these frames is asked for."""
    raise AssertionError(index)


FRAMES = Recording(Path("frames"), "own", ("000000",), unread)


def truth_of(objects: list[dict[str, Any]]) -> Truth:
    points = np.array([one["points"] for one in objects])
    box = np.array([(*one["at"], 0.8, *one.get("size", CAR), one.get("yaw", 0)) for one in objects])
    away = np.hypot(box[:, 0], box[:, 1])
    return Truth(
        frames=("000000",),
        time_s=np.zeros(1),
        frame=np.zeros(len(objects), np.int64),
        box=box.astype(float),
        class_names=tuple(one.get("class", "car") for one in objects),
        source_names=tuple(one.get("class", "car") for one in objects),
        track=np.array([one["track"] for one in objects]),
        num_points=points,
        occlusion=np.zeros(len(objects)),
        ignored=why_not([one.get("ignored", "") for one in objects], points, away),
        range_m=away,
    )


def side_of(
    name: str,
    objects: list[dict[str, Any]],
    found: list[dict[str, Any]],
    *,
    weather: tuple[str, float | None] = ("clear", None),
    lost: Mapping[str, frozenset[str]] | None = None,
) -> Side:
    truth = truth_of(objects)
    boxes = [(*one["at"], 0.8, *one.get("size", CAR), one.get("yaw", 0)) for one in found]
    detections = Detections(
        frames=("000000",),
        frame=np.zeros(len(found), np.int64),
        box=np.array(boxes, float).reshape(-1, 7),
        class_names=tuple(one.get("class", "car") for one in found),
        score=np.array([one.get("score", 0.9) for one in found], float),
        track=np.full(len(found), -1),
    )
    every = np.ones(len(found), bool)
    none = np.zeros(len(found), np.int64)
    seen = Seen(detections, truth, (0,), every, none, none.astype(float), "everywhere", ())
    fates = {
        ("000000", one["track"]): {
            "time_s": 0.0,
            "fate": one.get("fate", "seen" if one["points"] else "hidden"),
            "num_points": one["points"],
            "num_points_alone": one.get("alone", one["points"]),
            "hiders": one.get("hiders"),
        }
        for one in objects
    }
    rows = {("000000", one["track"]): row for row, one in enumerate(objects)}
    pairs = pairs_of(detections, truth)
    return Side(name, FRAMES, seen, pairs, rows, fates, weather, lost or {})


ONE = {"track": 7, "at": (20, 0), "points": 100}
HIT = {"at": (20, 0)}


def reason(
    after: list[dict[str, Any]],
    found: list[dict[str, Any]],
    before: list[dict[str, Any]] | None = None,
    criterion: Mapping[str, Criterion] = BY_DISTANCE,
    **more: Any,
) -> Any:
    """Why track 7, which is found before, is missed after."""
    hits = [{"at": one["at"], "class": one.get("class", "car")} for one in before or [ONE]]
    base = side_of("base", before or [ONE], hits)
    told = changes_between(base, side_of("value", after, found, **more), criterion, LEAST)
    (change,) = [one for one in told.changes if one.track == 7]
    assert change.way == "found to missed"
    # The other way round the same is won, for the same reason.
    back = changes_between(side_of("base", after, found, **more), base, criterion, LEAST)
    (won,) = [one for one in back.changes if one.track == 7]
    assert (won.way, won.reason.reason) == ("missed to found", change.reason.reason)
    return change


def test_hidden_by_what_came_before_it_and_not_by_what_stood_there() -> None:
    tree = {"what": "vegetation", "track": None, "share": 0.45}
    truck = {"what": "truck", "track": 31, "share": 0.4}
    before = {**ONE, "points": 60, "alone": 110, "hiders": [tree]}
    after = {**ONE, "points": 10, "alone": 110, "hiders": [tree, truck]}
    change = reason([after], [], [before])
    assert (change.reason.reason, change.reason.by, change.reason.by_track) == (
        "hidden", "truck", 31,
    )  # fmt: skip
    assert "40 %" in change.reason.told
    assert "60 points, now 10" in change.reason.told


def test_what_loses_all_points_is_missed_and_counts() -> None:
    gone = {**ONE, "points": 0, "alone": 100, "hiders": [{"what": "bus", "track": 9, "share": 1.0}]}
    change = reason([gone], [])
    assert (change.reason.reason, change.reason.by_track) == ("hidden", 9)
    assert change.points == (100, 0)


def test_weather_an_outage_and_a_lost_turn_take_points_that_nobody_hides() -> None:
    few = {**ONE, "points": 20, "alone": 22}
    assert reason([few], [], weather=("rain", 300.0)).reason.by == "rain"
    assert reason([few], [], weather=("rain", 300.0)).reason.reason == "weather"
    assert reason([few], []).reason.reason == "fewer points"
    told = reason([few], [], lost={"000000": frozenset({"south"})}).reason
    assert (told.reason, told.by) == ("turn lost", "south")
    assert reason([{**ONE, "points": 0, "fate": "turn lost"}], []).reason.reason == "turn lost"
    assert reason([{**ONE, "points": 0, "fate": "out of view"}], []).reason.reason == "out of view"


@pytest.mark.parametrize(
    ("found", "why", "said"),
    [
        ([], "not detected", "nothing"),
        ([{**HIT, "score": 0.35}], "score", "0.35 below 0.40"),
        ([{"at": (20, 1.6)}], "displaced", "1.6 m away"),
        ([{**HIT, "class": "truck"}], "another class", "truck"),
        # A weak box at the place and a sure one beside it: the sure one says more.
        ([{**HIT, "score": 0.1}, {"at": (21.2, 0)}], "displaced", "1.2 m"),
    ],
)
def test_with_as_many_points_the_detector_says_why(
    found: list[dict[str, Any]], why: str, said: str
) -> None:
    change = reason([ONE], found)
    assert change.reason.reason == why
    assert said in change.reason.told
    assert change.points == (100, 100)


def test_unlikely_boxes_of_a_class_that_is_not_there_explain_nothing() -> None:
    faint = {**HIT, "class": "pedestrian", "score": 0.1}
    base = side_of("base", [ONE], [{**HIT, "score": 0.6}, faint])
    least = thresholds_of(base, None)
    assert least["pedestrian"] == least["car"] == pytest.approx(0.6)
    after = side_of("value", [ONE], [faint])
    (change,) = changes_between(base, after, BY_DISTANCE, least).changes
    assert change.reason.reason == "not detected"


def test_one_box_for_two_is_merged_and_names_the_neighbour() -> None:
    two = [
        {**ONE, "class": "bicycle", "size": CYCLE},
        {"track": 8, "at": (20, 0.7), "points": 90, "class": "bicycle", "size": CYCLE},
    ]
    between = {"at": (20, 0.5), "class": "bicycle", "size": CYCLE}
    change = reason(two, [between], two)
    assert (change.reason.reason, change.reason.by, change.reason.by_track) == (
        "merged", "bicycle", 8,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("box", "why", "said"),
    [
        ({**HIT, "yaw": np.pi / 2 + np.pi}, "heading", "90 degrees"),
        ({**HIT, "size": (9.5, 2.0, 1.5)}, "size", "9.5 x 2.0 m in place of 4.5 x 1.8 m"),
        ({"at": (20, 0.95)}, "displaced", "0.9 m"),
    ],
)
def test_by_overlap_what_is_off_of_a_box_is_told(box: dict[str, Any], why: str, said: str) -> None:
    change = reason([ONE], [box], criterion=BY_OVERLAP)
    assert change.reason.reason == why
    assert said in change.reason.told


def test_what_is_the_same_or_only_on_one_side_is_no_change() -> None:
    other = {"track": 9, "at": (-15, 3), "points": 50}
    sides = side_of("base", [ONE], [HIT]), side_of("value", [ONE, other], [HIT])
    told = changes_between(*sides, BY_DISTANCE, LEAST)
    assert (told.changes, told.both, told.neither, told.apart) == ((), 1, 0, 1)


def test_who_counts_on_neither_side_is_left_out() -> None:
    far = {**ONE, "ignored": "outside"}
    told = changes_between(
        side_of("base", [far], [HIT]), side_of("v", [far], []), BY_DISTANCE, LEAST
    )
    assert (told.changes, told.both, told.neither) == ((), 0, 0)


def test_a_score_of_the_base_counts_on_both_sides() -> None:
    """Found by 0.45 against a score of 0.4, and missed with the same box against 0.5."""
    sides = side_of("base", [ONE], [HIT]), side_of("value", [ONE], [{**HIT, "score": 0.45}])
    assert not changes_between(*sides, BY_DISTANCE, LEAST).changes
    (one,) = changes_between(*sides, BY_DISTANCE, {"car": 0.5}).changes
    assert one.reason.reason == "score"
    assert one.said.score == pytest.approx(0.45)
    assert one.said.off_m == pytest.approx(0.0)
    assert replace(one, points=(1, 1)).score == pytest.approx(0.9)
