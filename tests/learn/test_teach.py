"""From a site to a detector: what is taught, judged and told, and that what is done stays."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import urbantwin as ut
from urbantwin.artefact.written_files import RECORD
from urbantwin.detections import read_detections
from urbantwin.errors import InputError
from urbantwin.experiments.lessons import lessons_of, moved_rig
from urbantwin.site import load_site

torch = pytest.importorskip(
    "torch", reason="torch is not installed: pip install 'urbantwin[detector]'"
)
pytestmark = pytest.mark.xdist_group("learn")

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"
#: Few and short drives.
ASKED = {"drives": 1, "judging": 1, "seconds": 3.0, "every": 1.0, "progress": False}


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """The example with one small sensor, and little around it."""
    folder = tmp_path / "site"
    shutil.copytree(EXAMPLE, folder)
    file = folder / "site.yaml"
    told = yaml.safe_load(file.read_text())
    told |= {"closed_loop": False}
    told["region"]["radius_m"] = 40
    told["traffic"] |= {"warmup_s": 5}
    told["rig"]["sensors"] = told["rig"]["sensors"][1:]
    file.write_text(yaml.safe_dump(told))
    return file


@pytest.mark.thorough
def test_a_place_becomes_a_detector_and_the_same_call_does_nothing(
    site: Path, tmp_path: Path
) -> None:
    torch.set_num_threads(1)
    out = tmp_path / "detector"
    planned = ut.model.teach(site, out, plan=True, **ASKED)
    assert not out.exists()
    assert 0 < planned.seconds[0] < planned.seconds[1]

    made = ut.model.teach(site, out, steps=2, workers=1, **ASKED)
    card = (out / "card.md").read_text()
    report = json.loads((out / "report-judge-1" / "evaluation.json").read_text())
    assert f"{report['frames']} frames" in card
    assert "It was judged on no real frame." in card
    assert (out / "model" / "model.onnx").is_file()
    ut.model.detect(out / "lessons" / "judge-1", tmp_path / "found", model=made, progress=False)
    assert len(read_detections(tmp_path / "found").frames) == report["frames"]
    drives = [ut.open(out / "lessons" / name).manifest for name in ("teach-1", "judge-1")]
    assert drives[0]["seeds"] != drives[1]["seeds"]

    before = {one: one.stat().st_mtime_ns for one in out.rglob("*") if one.is_file()}
    ut.model.teach(site, out, steps=2, workers=1, **ASKED)
    again = {
        one for one in out.rglob("*") if one.is_file() and before[one] != one.stat().st_mtime_ns
    }
    assert again <= {out / "card.md", out / RECORD}

    ut.model.teach(site, out, steps=3, workers=1, **ASKED)
    changed = {
        one.relative_to(out).parts[0]
        for one, when in before.items()
        if one.stat().st_mtime_ns != when and one.name != "steps.json"
    }
    assert "model" in changed
    assert "lessons" not in changed


@pytest.mark.thorough
def test_a_detector_is_improved_where_it_missed(site: Path, tmp_path: Path) -> None:
    torch.set_num_threads(1)
    out = tmp_path / "detector"
    made = ut.model.teach(site, out, steps=2, workers=1, **ASKED)
    better = ut.model.improve(
        made, out / "lessons" / "twin", tmp_path / "improved", drives=1, events=3, seconds=8.0,
        every=2.0, steps=1, workers=1, progress=False,
    )  # fmt: skip
    drives = tmp_path / "improved" / "drives"
    scenario = yaml.safe_load((drives / "more-1-motion-scenario.yaml").read_text())["events"]
    bare, more = (ut.open(drives / name).actors for name in ("more-1-motion-bare", "more-1-motion"))
    added = set(more["track"].to_pylist()) - set(bare["track"].to_pylist())
    assert len(added) == len(scenario) > 0
    new = more.filter(np.isin(more["track"].to_numpy(), sorted(added)))
    for event in scenario:
        assert better.missed[event["actor"]] > 0
        x, y = (new[axis].to_numpy() - event["place"][axis] for axis in ("x", "y"))
        assert np.hypot(x, y).min() < 35
    seeds = [ut.open(drives / name).manifest["seed"] for name in ("held-motion", "more-1-motion")]
    assert seeds[0] != seeds[1]
    for name, report in (*better.before.items(), *better.after.items()):
        assert name == "held"
        assert report.manifest["frames"] == 3
    assert (
        "## held (a drive with a seed of its own, 3 frames)"
        in (better.folder / "improvement.md").read_text()
    )


def test_drives_that_judge_differ_from_those_that_teach(site: Path) -> None:
    lessons = lessons_of(40, 3, 5)
    teaching = [one for one in lessons if not one.held]
    judging = [one for one in lessons if one.held]
    assert len(judging) == 3
    assert len({one.seed for one in lessons}) == 43
    assert not {one.time_of_day for one in judging} & {one.time_of_day for one in teaching}
    assert {one.weather for one in teaching} == {"clear", "rain", "fog", "snow"}
    many = lessons_of(700, 700, 1)
    assert len({one.seed for one in many}) == 1400
    spec = load_site(site).rig
    off = []
    for one in teaching:
        sensor = moved_rig(spec, one, 0.1, 0.5).sensors[0]
        off.append([sensor.east_m - spec.sensors[0].east_m,
                    (sensor.yaw_deg - spec.sensors[0].yaw_deg) / 5])  # fmt: skip
    assert np.abs(off).max() <= 0.1
    assert (np.ptp(off, axis=0) > 0.15).all()
    assert moved_rig(spec, judging[0], 0.1, 0.5).sensors == spec.sensors


def test_what_cannot_be_used_is_refused_before_anything_is_built(
    site: Path, tmp_path: Path
) -> None:
    cloud = tmp_path / "clouds"
    cloud.mkdir()
    np.zeros((10, 3), np.float32).tofile(cloud / "0001.bin")
    with pytest.raises(InputError):
        ut.model.teach(site, tmp_path / "out", real=[cloud], progress=False)
    with pytest.raises(InputError, match="is not there"):
        ut.model.teach(site, tmp_path / "out", background=["a=none.npz"], progress=False)
    with pytest.raises(InputError, match="-1 0"):
        ut.model.teach(site, tmp_path / "out", within=(-1.0, 0.0), progress=False)
    assert not (tmp_path / "out").exists()
