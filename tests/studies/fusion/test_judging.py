"""What detections are worth by common labels, and what a study tries."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="torch is not installed: pip install 'urbantwin[detector]'")

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.errors import InputError
from urbantwin.studies.fusion.judging import Judge, rows_of
from urbantwin.studies.fusion.nodes import Labelled
from urbantwin.studies.fusion.setting import STUDIES, settings_of
from urbantwin.studies.fusion.trial import Outcome

CAR, PERSON = DETECTED_CLASSES.index("car"), DETECTED_CLASSES.index("pedestrian")
FRAMES = 12


def labelled(frame: int) -> Labelled:
    """Ten cars that drive, ten people that stand, one car with few points, and one far away."""
    place = np.array([[6.0 * (k % 5), 8.0 * (k // 5)] for k in range(20)])
    place[:10, 0] += 0.5 * frame
    place = np.concatenate([place, [[2.0, 30.0], [200.0, 0.0]]])
    cars = np.arange(22) % 20 < 10
    cars[20:] = True
    size = np.where(cars[:, None], [4.5, 1.8, 1.6], [0.6, 0.6, 1.7])
    box = np.column_stack([place, np.full(22, 0.8), size, np.zeros(22)])
    points = np.full(22, 50)
    points[20] = 3
    names = tuple("car" if one else "pedestrian" for one in cars)
    return Labelled(box, names, np.arange(22), points, ("",) * 22)


def judge() -> Judge:
    return Judge(
        [str(k) for k in range(FRAMES)], np.arange(FRAMES) / 10.0,
        [labelled(k) for k in range(FRAMES)], np.zeros((FRAMES, 2)), 50.0, ("car", "pedestrian"),
    )  # fmt: skip


def detected(found_share: float, wrong: int = 0) -> list[Outcome]:
    """The first share of each class in every frame, and false alarms of the lowest scores."""
    said = []
    for frame in range(FRAMES):
        truth = labelled(frame)
        mine = [k for k in range(20) if k % 10 < 10 * found_share]
        alarm = np.tile(truth.box[0], (wrong, 1))
        alarm[:, 0], alarm[:, 1] = -30.0, -20.0 - 3 * np.arange(wrong)
        kind = [CAR if k < 10 else PERSON for k in mine] + [CAR] * wrong
        box = np.concatenate([truth.box[mine], alarm])
        score = np.array([0.9] * len(mine) + [0.1] * wrong)
        cost = {"bits": 4000.0, "bits_s": 40_000.0, "packets": 3.0, "age_s": 0.1}
        said.append(Outcome(box, np.array(kind, np.int64), score, **cost))
    return said


def test_right_boxes_are_worth_all_and_half_of_them_half() -> None:
    one = judge()
    assert one.objects == {"car": 10 * FRAMES, "pedestrian": 10 * FRAMES}
    assert one.distinct == 20
    every = one.verdict(detected(1.0))
    assert (every.mean, every.mean_iou) == (1.0, 1.0)
    assert (every.row()["map_low"], every.row()["map_high"]) == (100, 100)
    half = one.verdict(detected(0.5))
    assert half.mean == pytest.approx(0.5)  # twenty of forty levels of recall
    assert one.verdict(detected(0.0)).mean == 0.0
    assert one.verdict(detected(1.0, wrong=3)).mean == 1.0  # below all that is right
    far = detected(1.0)
    far[0] = replace(far[0], box=far[0].box + [300, 0, 0, 0, 0, 0, 0])
    assert one.verdict(far).mean == pytest.approx(11 / FRAMES, abs=1 / 40)
    part = one.verdict(far, np.arange(FRAMES) == 0)
    assert (part.mean, part.objects) == (0.0, 20)


def test_nobody_to_find_is_told() -> None:
    truth = labelled(0)
    few = replace(truth, num_points=np.full(22, 2))
    with pytest.raises(InputError, match="no car has 5 points within 50 m"):
        Judge(["0"], np.zeros(1), [few], np.zeros((1, 2)), 50.0, ("car",))


@pytest.mark.thorough
def test_rows_tell_bits_a_second_and_the_gain_over_the_receiver_alone() -> None:
    settings = settings_of(["bitrate", "loss"], 3, fails_from_s=5.0, last=2)
    found = {"alone": detected(0.5), "early": detected(1.0), "middle": detected(0.8),
             "late": detected(0.7)}  # fmt: skip
    rows = rows_of(settings, [found[setting.how.name] for setting in settings], judge())
    assert {row["kbit_s"] for row in rows} == {40.0}
    assert {row["objects"] for row in rows} == {20 * FRAMES}
    for row in rows:
        gain = {"alone": 0, "early": 50, "middle": 30, "late": 20}[row["way"]]
        assert row["gain"] == pytest.approx(gain)
        assert row["gain_low"] == pytest.approx(gain)


def test_every_study_has_its_settings() -> None:
    every = settings_of(STUDIES, 4, fails_from_s=5.0, last=3)
    assert {one.study for one in every} == set(STUDIES)
    for name in STUDIES:
        mine = [one for one in every if one.study == name]
        assert [one.how.name for one in mine].count("alone") == 1
        assert {one.how.name for one in mine} == {"alone", "early", "middle", "late"}
        for way in ("early", "middle", "late"):
            assert sum(one.how.name == way for one in mine) > 1, (name, way)
    assert {one.aligned for one in every if one.study == "latency"} == {False, True}
    assert {one.nodes for one in every if one.study == "nodes"} == {None, 2, 3, 4}
    with pytest.raises(InputError, match="unknown study 'weather'; expected bitrate, latency"):
        settings_of(["weather"], 2, fails_from_s=0.0, last=1)
