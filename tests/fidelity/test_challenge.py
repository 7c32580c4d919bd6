"""The challenge's protocol: closed forms, counted precision, and what a fit can feign."""

import json
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity import compare
from urbantwin.fidelity.challenge import (
    Box,
    average_precision,
    challenge_class,
    combined_score,
    cropped,
    fit_moments,
    mean_precision,
    normalised,
    read_detections,
    realism,
    score_clouds,
    score_sides,
)
from urbantwin.fidelity.frame import Boxes, Frame
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.sides import Side, survey
from urbantwin.geometry import box_ious


def test_the_formula():
    # As published: CD 2.1473, MMD 4.1803e-4, EMD 1.6458, FPD 0.7104 and mAP 0.1333 are worth
    # 0.9947, 0.9992, 0.6708, 0.9858, together 0.9126 and 0.4793 (a published entry of the LUMPI
    # track, whose detection score 0.1904 is 0.1333 / 0.7).
    raw = {"CD": 2.1473, "MMD": 4.1803e-4, "EMD": 1.6458, "FPD": 0.7104}
    each = [normalised(name, value) for name, value in raw.items()]
    assert each == pytest.approx([0.9947, 0.9992, 0.6708, 0.9858], abs=1e-4)
    score = combined_score(raw, 0.1333)
    assert score.realism == pytest.approx(0.9126, abs=1e-4)
    assert score.detection == pytest.approx(0.1904, abs=1e-4)
    assert score.combined == pytest.approx(0.4793, abs=1e-4)
    assert combined_score(raw, None).combined is None
    assert normalised("EMD", 9.0) == 0
    assert normalised("CD", 0.1) == 1


def test_the_crop_and_classes():
    points = np.array([[39.0, -39, 4.9], [41, 0, 0], [0, -41, 0], [0, 0, -5.1]])
    assert cropped(points).tolist() == [[39.0, -39, 4.9]]
    assert challenge_class("car", "Van") == "Van"
    assert challenge_class("pedestrian") == "Person"
    assert challenge_class("other", "tram") == "Unknown"


def test_realism_of_a_moved_cloud():
    rng = np.random.default_rng(0)
    frames = [rng.uniform([-30, -30, -4], [30, 30, 4], (800, 3)) for _ in range(3)]
    found = realism(frames, [frame + [0.06, 0, 0.08] for frame in frames])
    assert found["EMD"] == pytest.approx(0.1)
    assert found["FPD"] == pytest.approx(0.01)
    assert found["CD"] == pytest.approx(0.02, rel=0.05)
    assert 0 < found["MMD"] < 1e-3


def boxes_of(rows):
    return np.array(rows, np.float64)


def test_iou_against_open3d_and_closed_form():
    unit = boxes_of([[0, 0, 0, 2, 2, 2, 0]])
    half = boxes_of([[1, 0, 0, 2, 2, 2, 0], [0, 0, 1, 2, 2, 2, 0], [9, 9, 0, 2, 2, 2, 1]])
    assert box_ious(unit, half)[0] == pytest.approx([1 / 3, 1 / 3, 0])
    # A square turned by 45 degrees has an octagon of 8 (sqrt 2 - 1) in common with itself.
    turned = box_ious(unit, boxes_of([[0, 0, 0, 2, 2, 2, np.pi / 4]]))[0, 0]
    common = 8 * (np.sqrt(2) - 1)
    assert turned == pytest.approx(common / (8 / 2 * 2 - common))
    # Volumes by counting: points of one box inside the other, by another library.
    rng = np.random.default_rng(1)
    a, b = np.array([0, 0, 0, 4, 2, 1.5, 0.4]), np.array([0.5, 0.3, 0.2, 4.4, 1.8, 1.6, 0.7])
    boxes = []
    for x, y, z, length, width, height, yaw in (a, b):
        turn = o3d.geometry.get_rotation_matrix_from_xyz((0, 0, yaw))
        boxes.append(o3d.geometry.OrientedBoundingBox((x, y, z), turn, (length, width, height)))
    points = rng.uniform(-4, 4, (400_000, 3))
    cloud = o3d.utility.Vector3dVector(points)
    inside = [set(box.get_point_indices_within_bounding_box(cloud)) for box in boxes]
    counted = len(inside[0] & inside[1]) / len(inside[0] | inside[1])
    assert box_ious(a[None], b[None])[0, 0] == pytest.approx(counted, abs=0.02)


def at(x, name="Car", score=1.0, yaw=0.0):
    return Box(np.array([x, 0, 0, 4, 2, 1.5, yaw], np.float64), name, score)


def test_average_precision_by_hand():
    labels = {"a": [at(0), at(20)], "b": [at(0), at(20)]}
    assert average_precision(labels, labels, "Car") == 1
    assert average_precision(labels, {}, "Car") == 0
    assert average_precision(labels, labels, "Bus") is None
    # By falling score: right, wrong, right, the first found twice; of 4 labels. Recall 1/4 at
    # precision 1, 1/2 at 2/3; 20 of the 40 levels are never reached.
    told = {
        "a": [at(0.2, score=0.9), at(50, score=0.8), at(0.1, score=0.6)],
        "b": [at(20, score=0.7)],
        "unknown frame": [at(0, score=1)],
    }
    expected = (10 * 1 + 10 * 2 / 3) / 40
    assert average_precision(labels, told, "Car") == pytest.approx(expected)
    mean, each = mean_precision(labels | {"c": [at(0, "Bus")]}, told, ("Car", "Bus", "Van"))
    assert mean == pytest.approx(expected / 2)
    assert each["Van"] is None


def labelled_side(name, boxes):
    """A side of two frames with the same labels, and points around."""
    points = np.random.default_rng(5).uniform([-30, -30, -3], [30, 30, 3], (300, 3))

    def read(index):
        told = Boxes(np.array(boxes, np.float64), ("car",) * len(boxes), np.arange(len(boxes)))
        return Frame(points, boxes=told, name=f"{index:06d}")

    side = Side(name, Recording(Path("here"), "plain", ("000000", "000001"), read), 2)
    survey(side, lambda: None)
    return side


def test_perfect_detections_and_none_at_all(tmp_path):
    # The last box is beyond the space that counts: no label, and no wrong detection either.
    boxes = [[0, 0, 0, 4, 2, 1.5, 0.3], [20, 9, 0, 4, 2, 1.5, 2], [60, 0, 0, 4, 2, 1.5, 0]]
    sides = {name: labelled_side(name, boxes) for name in ("real", "synthetic")}
    rows = [{"box": box, "score": 0.5, "class": "Car"} for box in boxes]
    perfect = {"000000": rows, "000001": rows}

    def scored(told):
        (tmp_path / "found.json").write_text(json.dumps(told))
        return score_sides(sides, tmp_path / "found.json")

    found = scored(perfect)
    assert found["mean_average_precision"] == 1
    row = found["scores"]["twin"]
    assert row["detection"] == 1
    assert row["combined"] == pytest.approx(0.6 + 0.4 * row["realism"])
    for none in ({}, {"000000": [], "000001": []}):
        assert scored(none)["mean_average_precision"] == 0
    more = scored(perfect | {"999999": rows})
    assert more["mean_average_precision"] == 1
    assert any("999999" in note for note in more["notes"])
    with pytest.raises(InputError, match="names none of the labelled real frames"):
        scored({"999999": rows})


def test_the_fit_matches_moments_and_moves_least():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(500, 3)) @ np.diag([3.0, 1, 0.2]) + [1, 2, 3]
    target = rng.normal(size=(700, 3)) @ rng.normal(size=(3, 3)) - [5, 0, 0]
    fit = fit_moments(source, target)
    moved = fit.apply(source)
    assert moved.mean(axis=0) == pytest.approx(target.mean(axis=0))
    assert np.cov(moved, rowvar=False, bias=True) == pytest.approx(
        np.cov(target, rowvar=False, bias=True), abs=1e-9
    )
    # The map of least displacement between Gaussians is symmetric.
    assert fit.matrix == pytest.approx(fit.matrix.T)
    assert fit_moments(source, source).matrix == pytest.approx(np.eye(3))


def streets(seed, count, squeeze=1.0):
    rng = np.random.default_rng(seed)
    frames = []
    for _ in range(count):
        flat = rng.uniform([-35, -35, -3], [35, 35, -2.9], (120, 3))
        wall = rng.uniform([-35, 15, -3], [35, 15.2, 4], (60, 3))
        frames.append(np.concatenate([flat, wall]) * [1, squeeze, squeeze])
    return frames


def test_a_fit_raises_the_score_without_mending_the_twin():
    rows = score_clouds(
        streets(0, 8),
        {
            "twin": streets(1, 8, 0.8),
            "noise": [
                np.random.default_rng(2).normal(scale=(5, 5, 1), size=(180, 3)) for _ in range(8)
            ],
        },
    )
    assert rows["twin_fitted"]["raw"]["FPD"] < 0.4 * rows["twin"]["raw"]["FPD"]
    assert rows["twin_fitted"]["realism"] > rows["twin"]["realism"]
    # Noise that has nothing of a street is raised as well, and by more.
    gain = rows["noise_fitted"]["realism"] - rows["noise"]["realism"]
    assert gain > 0.2
    assert rows["real_against_real"]["realism"] > rows["twin_fitted"]["realism"] - 0.02


def test_the_held_out_half_is_never_fitted_to():
    real = streets(0, 6)
    other = {"twin": streets(1, 6, 0.8)}
    before = score_clouds(real, other)["twin_fitted"]["raw"]
    # A change of the held-out frames that keeps the training half: the fitted cloud is the same,
    # so its Chamfer distance changes by exactly what moved.
    moved = [*real[:3], *[frame + [0, 0, 100] for frame in real[3:]]]
    after = score_clouds(moved, other)["twin_fitted"]["raw"]
    assert after["FPD"] > 9_000 > before["FPD"]


@pytest.mark.thorough
def test_the_protocol_in_a_report(tmp_path):
    for name, seed in (("real", 0), ("twin", 1)):
        (tmp_path / name).mkdir()
        for index, points in enumerate(streets(seed, 4)):
            np.save(tmp_path / name / f"{index}.npy", points)
    compare(
        tmp_path / "real",
        tmp_path / "twin",
        tmp_path / "out",
        arbitrary=None,
        protocol="urbantwin-challenge",
    )
    told = json.loads((tmp_path / "out/report.json").read_text())["protocol"]
    assert told["scores"]["twin"]["combined"] is None
    assert 0.5 < told["scores"]["twin"]["realism"] <= 1
    assert "twin_fitted" in told["scores"]
    with pytest.raises(InputError, match="protocol"):
        compare(tmp_path / "real", tmp_path / "twin", tmp_path / "out", protocol="other")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[1]", "not a JSON object of frames"),
        ("{", "not JSON"),
        ('{"1": {}}', "not a list"),
        ('{"1": [{"box": [1], "score": 1, "class": "Car"}]}', "7 numbers"),
        ('{"1": [{"box": [0,0,0,1,1,0,0], "score": 1, "class": "Car"}]}', "extent"),
        ('{"1": [{"box": [0,0,0,1,1,NaN,0], "score": 1, "class": "Car"}]}', "not a finite"),
        ('{"1": [{"box": [0,0,0,1,1,1,0], "score": null, "class": "Car"}]}', "finite score"),
        ('{"1": [{"box": [0,0,0,1,1,1,0], "score": NaN, "class": "Car"}]}', "not a finite"),
        ('{"1": [{"box": [0,0,0,1,1,1,0], "score": 1, "class": "Tank"}]}', "Tank"),
    ],
)
def test_bad_detections(tmp_path, text, said):
    (tmp_path / "found.json").write_text(text)
    with pytest.raises(InputError, match=said):
        read_detections(tmp_path / "found.json")
