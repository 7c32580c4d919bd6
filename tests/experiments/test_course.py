"""The course of a campaign: what is made after what, what fails, what is left."""

from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
import yaml

from urbantwin.errors import StageError
from urbantwin.experiments.campaign.file import CampaignFile
from urbantwin.experiments.campaign.steps import Steps, steps_of
from urbantwin.experiments.course import Course, Outcome

from .test_campaign_file import EXAMPLE

MADE = {"frames": 20, "points": 100, "boxes": 3, "bytes": 1000, "processor_s": 2.0}


class Here:
    """A pool that does at once what it is given."""

    def submit(self, function, step):
        future = Future()
        try:
            future.set_result(function(step))
        except BaseException as error:  # as a pool hands it on
            future.set_exception(error)
        return future


class Maker:
    """Makes steps as folders with a manifest; some fail."""

    def __init__(self, place: Path, **failing: object) -> None:
        self.place, self.failing, self.made = place, failing, []

    def __call__(self, step):
        self.made.append(step.place)
        found = self.failing.get(step.name.replace("-", "_"))
        if isinstance(found, BaseException):
            raise found
        if found is not None:
            return found
        folder = self.place / step.place
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{step.kind}.json").write_text("{}")
        return Outcome({**MADE, "manifest_sha256": "0" * 64} if step.kind == "dataset" else {})


@pytest.fixture
def steps(tmp_path: Path) -> Steps:
    path = tmp_path / "grid.yaml"
    fields = {"seeds": [1, 2], "weather": ["clear", "fog"], "duration_s": 2}
    path.write_text(yaml.safe_dump({"sites": {"a": str(EXAMPLE)}, **fields}))
    return steps_of(CampaignFile.read(path))


def run(steps: Steps, place: Path, make: Maker, **options: object) -> Course:
    course = Course(steps.all, place)
    course.run(Here(), make, abreast=1, tell=lambda _: None, **options)
    return course


def test_there_are_frames_before_all_motions_are_driven(steps: Steps, tmp_path: Path) -> None:
    make = Maker(tmp_path)
    course = run(steps, tmp_path, make)
    assert make.made == [
        "twins/a", "motions/a-1-none", "datasets/a-1-own-clear-none", "datasets/a-1-own-fog-none",
        "motions/a-2-none", "datasets/a-2-own-clear-none", "datasets/a-2-own-fog-none",
    ]  # fmt: skip
    assert course.left == 0
    assert course.frames == 80
    assert course.share_done({}) == 1
    again = Maker(tmp_path)
    assert run(steps, tmp_path, again).counts("dataset")["done"] == 4
    assert again.made == []


def test_what_fails_takes_what_needs_it_along_and_nothing_else(
    steps: Steps, tmp_path: Path
) -> None:
    make = Maker(tmp_path, a_1_none=Outcome(why="a car was in the way", attempts=2))
    course = run(steps, tmp_path, make)
    assert course.failed["motions/a-1-none"] == "a car was in the way"
    assert course.failed["datasets/a-1-own-fog-none"] == "motions/a-1-none: a car was in the way"
    assert course.counts("dataset") == {"done": 2, "dropped": 2}
    assert course.left == 0
    later = Maker(tmp_path)  # it is tried again, with what needs it, and nothing else is
    assert run(steps, tmp_path, later).left == 0
    assert later.made == [one for one in steps.all if "a-1" in one]


def test_a_deleted_dataset_is_made_again_and_a_twin_that_nobody_needs_is_not(
    steps: Steps, tmp_path: Path
) -> None:
    run(steps, tmp_path, Maker(tmp_path))
    for gone in ("datasets/a-1-own-fog-none/dataset.json", "twins/a/twin.json"):
        (tmp_path / gone).unlink()
    again = Maker(tmp_path)
    run(steps, tmp_path, again)
    assert again.made == ["twins/a", "datasets/a-1-own-fog-none"]
    (tmp_path / "twins/a/twin.json").unlink()
    none = Maker(tmp_path)
    assert run(steps, tmp_path, none).left == 0
    assert none.made == []


def test_a_full_disk_ends_the_campaign_and_nothing_is_noted_as_failed(
    steps: Steps, tmp_path: Path
) -> None:
    full = Outcome(why="there is no room left on its disk", no_room=True)
    course = Course(steps.all, tmp_path)
    with pytest.raises(StageError, match="no room left"):
        course.run(
            Here(), Maker(tmp_path, a_2_none=full), abreast=1, tell=lambda _: None
        )  # fmt: skip
    assert course.failed == {}
    later = Maker(tmp_path)
    assert run(steps, tmp_path, later).failed == {}
    assert later.made == [one for one in steps.all if "a-2" in one]


def test_a_killed_worker_is_tried_once_more(steps: Steps, tmp_path: Path) -> None:
    make = Maker(tmp_path, a_1_own_fog_none=BrokenProcessPool("killed"))
    course = Course(steps.all, tmp_path)
    for _ in range(2):
        with pytest.raises(BrokenProcessPool):
            course.run(Here(), make, abreast=1, tell=lambda _: None)
    course.run(Here(), make, abreast=1, tell=lambda _: None)
    assert make.made.count("datasets/a-1-own-fog-none") == 2
    assert list(course.failed) == ["datasets/a-1-own-fog-none"]
    assert "killed" in course.failed["datasets/a-1-own-fog-none"]
    assert course.counts("dataset")["done"] == 3


def test_a_plan_goes_by_what_was_measured(steps: Steps, tmp_path: Path) -> None:
    course = run(steps, tmp_path, Maker(tmp_path), most=1)
    assert course.counts("dataset")["done"] == 1
    plan = Course(steps.all, tmp_path).plan()
    assert plan.steps == {"twin": 0, "motion": 1, "dataset": 3}
    assert plan.frames == 3 * 10  # at 5 Hz
    assert plan.measured == {"twin": 1, "motion": 1, "dataset": 1}
    assert plan.size == pytest.approx(3 * MADE["bytes"])
    reckoned_motion_s = 0.5 * 2  # nothing was noted of how long it took
    assert plan.seconds == pytest.approx(3 * MADE["processor_s"] + reckoned_motion_s)
