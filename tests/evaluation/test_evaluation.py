"""Detections whose precision and errors are known by how they were made."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import Polygon
from shapely.affinity import rotate, translate

import urbantwin as ut
from urbantwin.detections import joined, write_detections
from urbantwin.errors import InputError
from urbantwin.evaluation import evaluate, read_labelled
from urbantwin.evaluation.tracks import judged_tracks
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry.box_overlap import plan_overlaps

from ..whole_page import whole_page

FRAMES, CARS = 10, 4
Floats = NDArray[np.float64]


def _boxes(frame: int) -> Floats:
    """Cars in a row, far from each other, that turn as they go."""
    x = 10.0 * np.arange(CARS) + 0.8 * frame
    return np.column_stack(
        [x, 3.0 * np.arange(CARS), *np.tile([[0.75], [4.0], [2.0], [1.5]], CARS), 0.1 * x]
    )


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("street")
    rng = np.random.default_rng(1)
    lines = ["frame,id,class,x,y,z,length,width,height,yaw,num_points,ignore"]
    for frame in range(FRAMES):
        boxes = _boxes(frame)
        points = [rng.uniform([-60, -60, 0], [100, 60, 0.01], (500, 3))]
        for number, (x, y, z, length, width, height, yaw) in enumerate(boxes):
            inside = rng.uniform(-0.45, 0.45, (50, 3)) * [length, width, height]
            c, s = np.cos(yaw), np.sin(yaw)
            points.append(inside @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + [x, y, z])
            box = f"{x},{y},{z},{length},{width},{height},{yaw}"
            lines.append(f"{frame + 1},{number},car,{box},50,0")
        # Two that do not count: ignored, and with two points.
        lines.append(f"{frame + 1},8,car,-30,0,0.75,4,2,1.5,0,50,1")
        lines.append(f"{frame + 1},9,car,-30,20,0.75,4,2,1.5,0,2,0")
        np.concatenate(points).astype(np.float32).tofile(folder / f"{frame + 1:04d}.bin")
    (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
    return folder


def _judged(data: Path, change: Any) -> dict[str, Any]:
    """Return the figures of cars; ``change`` maps (frame, boxes) to boxes and scores."""
    found = []
    for frame in range(FRAMES):
        boxes, scores = change(frame, _boxes(frame))
        found.append((np.reshape(boxes, (-1, 7)), ["car"] * len(boxes), np.array(scores)))
    names = [f"{frame + 1:04d}" for frame in range(FRAMES)]
    recording = open_recording(data)
    seen = read_labelled(joined(names, found), recording)
    return evaluate(seen, layout=recording.layout, draws=50).classes["car"].figures


def _ap(figures: dict[str, Any], name: str) -> float:
    return float(figures["ap"][name]["ap"])


def test_all_found_is_a_precision_of_one(data: Path) -> None:
    figures = _judged(data, lambda frame, boxes: (boxes, [0.9] * CARS))
    assert figures["objects"] == FRAMES * CARS
    assert {row["ap"] for row in figures["ap"].values()} == {1.0}


def test_tracks_are_told_where_both_sides_have_them(data: Path) -> None:
    recording = open_recording(data)
    names = [f"{frame + 1:04d}" for frame in range(FRAMES)]
    boxes = [_boxes(frame) for frame in range(FRAMES)]
    # A box where an ignored one is, one of nobody, and two cars that change names halfway.
    extra = np.array([[-30, 0, 0.75, 4, 2, 1.5, 0], [0, -40, 0.75, 4, 2, 1.5, 0]])
    found = joined(
        names,
        [(np.concatenate([one, extra]), ["car"] * (CARS + 2), np.full(CARS + 2, 0.9))
         for one in boxes],
    )  # fmt: skip
    whose = np.tile(np.arange(CARS + 2), (FRAMES, 1))
    whose[FRAMES // 2 :, :2] = [1, 0]
    untold = read_labelled(found, recording)
    assert judged_tracks(evaluate(untold, layout=recording.layout, draws=2)) is None
    seen = read_labelled(replace(found, track=whose.ravel()), recording)
    # Plain boxes have no tracks: here their order tells who is who.
    labelled = np.tile(np.arange(CARS + 2), FRAMES)
    seen = replace(seen, truth=replace(seen.truth, track=labelled))
    told = judged_tracks(evaluate(seen, layout=recording.layout, draws=2))
    assert told is not None
    cars = told["car"]
    objects = FRAMES * CARS
    assert cars["objects"] == objects
    assert cars["tracks"] == CARS
    assert cars["tracks_found"] == CARS + 1
    assert cars["swaps"] == 2
    assert cars["mota"] == pytest.approx((objects - FRAMES - 2) / objects)
    right = objects - 2 * (FRAMES // 2)
    assert cars["idf1"] == pytest.approx(2 * right / (2 * objects + FRAMES))


def test_half_found_is_half_the_recall(data: Path) -> None:
    figures = _judged(data, lambda frame, boxes: (boxes[:2], [0.9] * 2))
    assert _ap(figures, "iou_3d_0.7") == pytest.approx(0.5)


def test_a_sure_false_alarm_in_every_frame_halves_the_precision(data: Path) -> None:
    def change(frame: int, boxes: Floats) -> tuple[Floats, list[float]]:
        wrong = np.tile([[0.0, -40.0, 0.75, 4.0, 2.0, 1.5, 0.0]], (CARS, 1))
        wrong[:, 1] -= 3.0 * np.arange(CARS)
        return np.concatenate([wrong, boxes]), [0.95] * CARS + [0.9] * CARS

    figures = _judged(data, change)
    # All false ones come first: at the k-th of 40 hits the precision is k / (40 + k), at most 1/2.
    assert _ap(figures, "within_1_m") == pytest.approx(0.5, abs=0.01)


def test_shifts_turns_and_sizes_are_told_as_they_were_made(data: Path) -> None:
    def change(frame: int, boxes: Floats) -> tuple[Floats, list[float]]:
        moved = boxes.copy()
        moved[:, 0] += 0.3 * np.cos(moved[:, 6] + np.pi / 2)
        moved[:, 1] += 0.3 * np.sin(moved[:, 6] + np.pi / 2)
        moved[:, 3] *= 1.25
        moved[:, 6] += 0.2
        return moved, [0.9] * CARS

    figures = _judged(data, change)
    errors = json.dumps(figures)
    told = figures["errors"]
    assert told["ate_m"] == pytest.approx(0.3, abs=1e-6), errors
    assert told["ase"] == pytest.approx(0.2, abs=1e-6), errors
    assert told["aoe_rad"] == pytest.approx(0.2, abs=1e-6), errors
    assert _ap(figures, "within_0.5_m") == 1.0


def test_boxes_that_do_not_count_neither_help_nor_hurt(data: Path) -> None:
    def change(frame: int, boxes: Floats) -> tuple[Floats, list[float]]:
        neutral = [[-30, 0, 0.75, 4, 2, 1.5, 0], [-30, 20, 0.75, 4, 2, 1.5, 0]]
        return np.concatenate([boxes, neutral]), [0.9] * CARS + [0.99] * 2

    figures = _judged(data, change)
    assert figures["objects"] == FRAMES * CARS
    assert {row["ap"] for row in figures["ap"].values()} == {1.0}


def test_the_interval_covers_the_figure_and_no_more_than_chance(data: Path) -> None:
    figures = _judged(data, lambda frame, boxes: (boxes[: 1 + frame % 4], [0.9] * (1 + frame % 4)))
    low, high = figures["ap"]["within_1_m"]["ap_ci95"]
    assert 0.25 <= low < _ap(figures, "within_1_m") < high <= 1.0


def _street(seed: int) -> list[dict[str, Floats]]:
    """Cars that stand apart, some missed, some found far off, some invented.

    ``found`` are those detected that are not invented: Argoverse 2 lets a surer box far away take
    the nearest car from the box that is on it. It measures distances in space.
    """
    draw = np.random.default_rng(seed)
    frames = []
    for _ in range(8):
        count = int(draw.integers(2, 9))
        x = 12.0 * draw.permutation(12)[:count] - 60 + draw.uniform(-1, 1, count)
        sizes = draw.uniform([3.5, 1.6, 1.3], [5.5, 2.2, 2.0], (count, 3))
        labelled = np.column_stack(
            [x, draw.uniform(-30, 30, count), np.full(count, 0.8), sizes,
             draw.uniform(-np.pi, np.pi, count)]
        )  # fmt: skip
        found = labelled[draw.random(count) < 0.8]
        found = found + draw.normal(0, [0.8, 0.8, 0, 0.2, 0.1, 0.1, 0.3], found.shape)
        false = np.tile([[0.0, 200, 0.8, 4, 2, 1.5, 0]], (int(draw.integers(0, 4)), 1))
        false[:, 0] = 15 * np.arange(len(false))
        boxes = np.concatenate([found, false])
        detected = np.column_stack([boxes, draw.random(len(boxes))])
        frames.append({"labelled": labelled, "detected": detected, "found": detected[: len(found)]})
    return frames


def test_they_are_what_the_kits_of_nuscenes_and_argoverse_say(
    judge: Callable[..., Any], tmp_path: Path
) -> None:
    scenes = [_street(seed) for seed in range(12)]
    job = [[{k: v.tolist() for k, v in one.items()} for one in frames] for frames in scenes]
    for number, (frames, said) in enumerate(
        zip(scenes, judge("detection_figures", job=job), strict=True)
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        lines = ["frame,id,class,x,y,z,length,width,height,yaw,num_points"]
        for index, one in enumerate(frames, 1):
            corners = np.array([[-300, -300, 0], [300, 300, 0], [0, 0, 0]], np.float32)
            corners.tofile(folder / f"{index:04d}.bin")  # all of it is seen
            lines += [f"{index},0,car,{','.join(map(repr, b.tolist()))},50"
                      for b in one["labelled"]]  # fmt: skip
        (folder / "boxes.csv").write_text("\n".join(lines) + "\n")
        found = [
            (one["detected"][:, :7], ["car"] * len(one["detected"]), one["detected"][:, 7])
            for one in frames
        ]
        recording = open_recording(folder, columns=3)
        seen = read_labelled(joined(recording.names, found), recording)
        told = evaluate(seen, layout=recording.layout, draws=2).classes["car"].figures
        for name, precision in said["nuscenes"].items():
            assert told["ap"][name]["ap_nuscenes"] == pytest.approx(precision, abs=1e-9), name
        argoverse = said["argoverse"]
        assert told["errors"]["boxes"] == argoverse["hits"]["within_2_m"]
        # Argoverse 2 has another IoU of sizes: the larger of each side makes up its union.
        for name in ("ate_m", "aoe_rad"):
            assert told["errors"][name] == pytest.approx(argoverse[name], abs=1e-6), name
        for name, error in said["nuscenes_errors"].items():
            assert told["errors"][name] == pytest.approx(error, abs=1e-6), name


def test_overlaps_are_those_of_polygons() -> None:
    rng = np.random.default_rng(3)
    a, b = (
        np.column_stack(
            [*rng.uniform(-2, 2, (2, 30)), np.zeros(30), *rng.uniform(1, 5, (3, 30)), yaw]
        )
        for yaw in rng.uniform(-4, 4, (2, 30))
    )

    def polygon(box: Floats) -> Polygon:
        x, y, _, length, width, _, yaw = box
        half = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length / 2, width / 2]
        return translate(rotate(Polygon(half), yaw, origin=(0, 0), use_radians=True), x, y)

    ours = np.asarray(plan_overlaps(a, b))
    both = np.array([polygon(p).intersection(polygon(q)).area for p, q in zip(a, b, strict=True)])
    assert ours.shape == both.shape, ours.shape
    assert ours == pytest.approx(both, abs=1e-9)


def test_the_command_writes_a_page_and_refuses_other_frames(data: Path, tmp_path: Path) -> None:
    found = [(_boxes(frame), ["car"] * CARS, np.full(CARS, 0.9)) for frame in range(FRAMES)]
    names = [f"{frame + 1:04d}" for frame in range(FRAMES)]
    write_detections(tmp_path / "found", joined(names, found), {})
    made = ut.model.evaluate(tmp_path / "found", data, tmp_path / "report", progress=False)
    assert made.figures["car"]["ap"]["within_1_m"]["ap"] == 1.0
    assert "car 100" in made.in_short
    page = whole_page((tmp_path / "report" / "evaluation.html").read_text())
    assert "100.0 100–100" in page.cells
    strange = [f"street {name}x" for name in "abcdefghij"]
    write_detections(tmp_path / "strange", joined(strange, found), {})
    with pytest.raises(InputError, match="none of the frames"):
        ut.model.evaluate(tmp_path / "strange", data, tmp_path / "other", progress=False)
