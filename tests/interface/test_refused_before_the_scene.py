"""What stands wrong is refused before the scene is built, which takes nearly all of the time."""

import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

import urbantwin as ut

from ..thorough import further

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues"


def site_with(folder: Path, sensor: dict[str, Any]) -> Path:
    """The example with one sensor."""
    shutil.copytree(EXAMPLE, folder)
    fields = yaml.safe_load((folder / "site.yaml").read_text())
    fields["region"] = {"radius_m": 80}
    fields["rig"]["sensors"] = [{"name": "pole", "model": "OS1-64", **sensor}]
    (folder / "site.yaml").write_text(yaml.safe_dump(fields))
    return folder / "site.yaml"


@pytest.mark.parametrize(
    ("sensor", "place", "problem"),
    [
        ({"east_m": 28.0, "north_m": -65.0, "height_m": 5.0}, "height_m", "inside a building"),
        *further(
            (
                {"east_m": 500.0, "north_m": 0.0, "height_m": 5.0},
                "east_m",
                "no ground at 500 m east",
            ),
            ({"east_m": 12.0, "north_m": 12.0, "up_m": -9.0}, "up_m", "-9 m is under the ground"),
            (
                {"east_m": 12.0, "north_m": 12.0, "altitude_m": -900.0},
                "altitude_m",
                "under the ground",
            ),
        ),
    ],
)
def test_a_sensor_that_cannot_stand_is_refused_before_the_scene(
    tmp_path: Path, sensor: dict[str, Any], place: str, problem: str
) -> None:
    told: list[str] = []
    site = site_with(tmp_path / "site", sensor)
    with pytest.raises(ut.InputError) as error:
        ut.build(
            site, tmp_path / "twin", pictures=False, progress=lambda _, doing: told.append(doing)
        )
    assert problem in str(error.value)
    assert error.value.place == f"rig.sensors[0].{place}"
    assert not [doing for doing in told if doing.startswith("scene")]
    assert not (tmp_path / "twin").exists()


@pytest.mark.thorough
def test_what_is_about_right_is_left_to_the_scene(tmp_path: Path) -> None:
    deep = site_with(tmp_path / "deep", {"east_m": 12.0, "north_m": 12.0, "up_m": -9.0})
    with pytest.raises(ut.InputError, match=r"which is at (-?\d+\.\d+) m there") as error:
        ut.build(deep, tmp_path / "twin", pictures=False, progress=False)
    ground = float(re.findall(r"which is at (\S+) m", str(error.value))[0])
    told: list[str] = []
    nearly = {"east_m": 12.0, "north_m": 12.0, "up_m": ground - 0.4}
    with pytest.raises(ut.InputError, match="under the ground") as error:
        ut.build(
            site_with(tmp_path / "nearly", nearly),
            tmp_path / "twin",
            pictures=False,
            progress=lambda _, doing: told.append(doing),
        )
    assert [doing for doing in told if doing.startswith("scene")]
    exact = float(re.findall(r"which is at (\S+) m", str(error.value))[0])
    assert exact == pytest.approx(ground, abs=0.2)


@pytest.mark.parametrize(
    ("changed", "workers", "words"),
    [
        ({}, 0, "--workers: 0; expected at least 1"),
        ({"ride": {"class": "bus"}}, 1, "rig.ride.class: the traffic has no bus"),
    ],
)
def test_run_refuses_first_what_its_last_stage_would(
    tmp_path: Path, changed: dict[str, Any], workers: int, words: str
) -> None:
    rides = {"forward_m": 0.0, "left_m": 0.0, "above_roof_m": 0.3}
    stands = {"east_m": 12.0, "north_m": 12.0, "height_m": 5.0}
    site = site_with(tmp_path / "site", rides if changed else stands)
    fields = yaml.safe_load(site.read_text())
    fields["rig"] |= changed
    fields["traffic"]["per_hour"] = {"car": 300}
    site.write_text(yaml.safe_dump(fields))
    told: list[str] = []
    with pytest.raises(ut.InputError, match=words):
        ut.run(
            site,
            tmp_path / "out",
            workers=workers,
            progress=lambda _, doing: told.append(doing),
        )
    assert told == []
