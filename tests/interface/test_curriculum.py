"""Graded datasets: what each grade asks for is what is in it, and what it says of itself."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.experiments.ladder import LADDERS, Grade, graded_rig, refuse_nobody
from urbantwin.interface.rig import placed, rig_spec_on
from urbantwin.site import RigSpec

from .conftest import Line

SENSOR = np.array([12.0, -12.0])  # the site's only one
RANGE_M = 30.0
GRADES = [
    {"name": "sparse", "density": 0.2},
    {"name": "near", "range_m": RANGE_M},
    {"name": "all", "raised_m": -1.0},
]


@pytest.fixture(scope="module")
def graded(line: Line, tmp_path_factory: pytest.TempPathFactory) -> ut.experiment.Curriculum:
    folder = tmp_path_factory.mktemp("graded")
    how = {"seconds": 8.0, "start": 4.0, "stop": 4.2, "twin": str(line.twin.folder)}
    (folder / "grid.yaml").write_text(yaml.safe_dump({"grades": GRADES, **how}))
    made = ut.experiment.run(folder / "grid.yaml", folder / "out", workers=1, progress=False)
    assert isinstance(made, ut.experiment.Curriculum)
    return made


def counted(dataset: ut.Dataset) -> dict[tuple[str, int], float]:
    """Frame and track of the boxes in reach, and how far they are from the sensor in plan."""
    sensor = (np.array(dataset.manifest["dataset_SE3_site"]) @ [*SENSOR, 0.0, 1.0])[:2]
    return {
        (box["frame"], box["track"]): float(np.hypot(box["x"] - sensor[0], box["y"] - sensor[1]))
        for box in dataset.boxes.to_pylist()
        if box["ignored"] not in ("outside", "far")
    }


@pytest.mark.thorough
def test_labels_count_as_far_as_the_grade_says(graded: ut.experiment.Curriculum) -> None:
    near, every = (counted(graded.datasets[name]) for name in ("near", "all"))
    assert any(away > RANGE_M + 1.0 for away in every.values())
    assert max(near.values()) < RANGE_M + 1.0
    assert {key for key, away in every.items() if away < RANGE_M - 1.0} <= set(near) <= set(every)
    told = graded.datasets["near"].manifest["objects"]
    assert told["per_frame"] == pytest.approx(len(near) / 3, abs=1e-3)


def test_what_is_measured_is_what_the_boxes_say(graded: ut.experiment.Curriculum) -> None:
    everything = graded.datasets["all"]
    told = everything.manifest["objects"]
    boxes = everything.boxes.to_pandas()
    boxes = boxes[~boxes.ignored.isin(["outside", "far"])]
    assert told["per_frame"] == pytest.approx(len(boxes) / 3, abs=1e-3)
    assert told["points"] == boxes[boxes.num_points > 0].num_points.median()
    alone = boxes[boxes.num_points_alone >= 10]
    assert len(alone), "the scene has objects near the sensor"
    assert told["occlusion"] == pytest.approx(alone.occlusion.mean(), abs=1e-3)
    assert told["hidden"] == pytest.approx((alone.num_points == 0).mean(), abs=1e-3)
    sparse, _, every = graded.summary()["grades"]
    assert sparse["objects_per_frame"] < every["objects_per_frame"]
    rigs = [one.manifest["made_from"]["record"]["rig"] for one in graded.datasets.values()]
    assert rigs[1]["sensors"][0]["height_m"] - rigs[2]["sensors"][0]["height_m"] == 1.0


def test_each_named_ladder_climbs_and_nothing_sinks_below_two_metres(line: Line) -> None:
    spec = RigSpec.model_validate(
        {
            "sensors": [
                {"name": "a", "model": "VLP-16", "east_m": 0.0, "north_m": 0.0, "height_m": 2.5}
            ]
        }
    )
    for grades in LADDERS.values():
        assert len({one.name for one in grades}) == len(grades)
        density = [one.density for one in grades]
        raised = [-one.raised_m for one in grades]
        reach = [one.range_m or np.inf for one in grades]
        assert density == sorted(density)
        assert raised == sorted(raised)
        assert reach == sorted(reach)
        heights = [graded_rig(spec, one).sensors[0].height_m for one in grades]
        assert min(height for height in heights if height is not None) >= 2.0


@pytest.mark.parametrize(
    ("ladder", "said"),
    [
        ("ladder: hard", "there is no ladder 'hard'"),
        ("ladder: range\ngrades: [{name: a}]", "needs a ladder or grades"),
        ("grades: [{name: a}, {name: a}]", "names a grade twice"),
        ("grades: [{name: a, density: -1}]", "density (line 1)"),
    ],
)
def test_a_ladder_that_is_wrong_is_refused(
    line: Line, tmp_path: Path, ladder: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    grid, out = tmp_path / "grid.yaml", tmp_path / "out"
    grid.write_text(f"{ladder}\ntwin: {line.twin.folder}\n")
    assert main(["experiment", "run", str(grid), "-o", str(out)]) == 2
    assert said in capsys.readouterr().err
    assert not out.exists()


def test_a_grade_with_nobody_in_reach_is_refused(
    graded: ut.experiment.Curriculum, line: Line
) -> None:
    twin = ut.Twin.open(line.twin)
    spec, file = rig_spec_on(twin, None)
    motion = ut.Motion.open(graded.folder / "motion-density-1")
    touch, near = (Grade(name="touch", range_m=1.0), Grade(name="near", range_m=RANGE_M))
    refuse_nobody(near, placed(graded_rig(spec, near), twin, file), motion, twin.region, [7.0])
    rig = placed(graded_rig(spec, touch), twin, file)
    with pytest.raises(ut.InputError, match=r"grade touch: .*no actor within 1 m.* comes to \d+ m"):
        refuse_nobody(touch, rig, motion, twin.region, [7.0, 7.1])
