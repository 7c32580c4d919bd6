"""The file of a campaign: its cells, its steps, and what is wrong with it."""

from pathlib import Path

import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.experiments.campaign.file import CampaignFile
from urbantwin.experiments.campaign.steps import steps_of

EXAMPLE = Path(__file__).parents[2] / "examples" / "two-avenues" / "site.yaml"
RIG = {
    "rate_hz": 10,
    "sensors": [{"name": "pole", "model": "VLP-16", "east_m": 5, "north_m": 5, "height_m": 4}],
}


def written(folder: Path, **fields: object) -> Path:
    path = folder / "grid.yaml"
    path.write_text(yaml.safe_dump({"sites": [str(EXAMPLE)], **fields}, sort_keys=False))
    return path


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "pole.yaml"
    path.write_text(yaml.safe_dump(RIG))
    return path


def keys(path: Path) -> dict[str, str]:
    return {place: step.key for place, step in steps_of(CampaignFile.read(path)).all.items()}


def test_twins_and_motions_are_shared_by_the_cells(tmp_path: Path, rig: Path) -> None:
    path = written(
        tmp_path, seeds=[1, 2], rigs=["own", rig.name], weather=["clear", "fog"], duration_s=2,
        exclude=[{"rig": "pole", "weather": "fog", "seed": [2]}],
    )  # fmt: skip
    steps = steps_of(CampaignFile.read(path))
    assert [one.place for one in steps.of("twin")] == ["twins/two-avenues"]
    assert [one.place for one in steps.of("motion")] == [
        "motions/two-avenues-1-none", "motions/two-avenues-2-none",
    ]  # fmt: skip
    names = [one.name for one in steps.of("dataset")]
    assert len(names) == 2 * 2 * 2 - 1
    assert names[0] == "two-avenues-1-own-clear-none"
    assert "two-avenues-2-pole-fog-none" not in names
    one = steps.all["datasets/two-avenues-1-pole-fog-none"]
    assert one.needs == ("twins/two-avenues", "motions/two-avenues-1-none")
    # 16 beams of a VLP-16 at 10 Hz: 1800 columns; 20 frames of 2 s.
    assert (one.size, one.rays) == (20, 16 * 1800)


def test_a_change_of_an_input_changes_the_keys_of_what_depends_on_it(
    tmp_path: Path, rig: Path
) -> None:
    fields = {"seeds": [1, 2], "rigs": ["own", rig.name], "duration_s": 2}
    path = written(tmp_path, **fields)
    before = keys(path)
    written(tmp_path, **fields, weather=["clear", "rain"])
    more = keys(path)
    assert before.items() < more.items()
    rig.write_text(yaml.safe_dump({**RIG, "rate_hz": 5}), encoding="utf-8")
    after = keys(written(tmp_path, **fields))
    assert {place for place in before if before[place] != after[place]} == {
        "datasets/two-avenues-1-pole-clear-none", "datasets/two-avenues-2-pole-clear-none",
    }  # fmt: skip
    longer = keys(written(tmp_path, **{**fields, "duration_s": 3}))
    assert {place for place in before if after[place] == longer[place]} == {"twins/two-avenues"}


def test_a_changed_map_changes_everything_of_its_site(tmp_path: Path) -> None:
    import shutil

    shutil.copytree(EXAMPLE.parent, tmp_path / "site")
    path = written(tmp_path, sites={"a": "site", "b": str(EXAMPLE)})
    before = keys(path)
    extract = tmp_path / "site" / "two-avenues.osm"
    extract.write_text(extract.read_text().replace("</osm>", "\n</osm>"))
    after = keys(path)
    assert all((before[place] == after[place]) == ("/b" in place) for place in before)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"seed": [1]}, "seed (line 3): is not a field that is known here; expected 'seeds'"),
        ({"sites": []}, "sites (line 1): is empty; expected at least one"),
        ({"sites": ["no.yaml"]}, "sites[0] (line 2): "),
        ({"sites": [str(EXAMPLE)] * 2}, "sites[1] (line 3): two of them are called two-avenues"),
        ({"seeds": [1, 2, 1]}, "seeds (line 3): names a seed twice"),
        ({"seeds": []}, "seeds (line 3): is empty"),
        ({"rigs": ["own", "own"]}, "rigs[1] (line 5): two of them are called own"),
        ({"weather": ["fgo"]}, "weather[0] (line 4): there is no weather 'fgo'; expected 'fog'"),
        ({"weather": {"a/b": {}}}, "'a/b' is no name for a part of a folder's"),
        ({"weather": {"w": {"visibility": 3}}}, "expected 'visibility_m'"),
        ({"weather": {"w": {"visibility_m": -3}}}, "weather.w.visibility_m (line 5): is -3"),
        ({"weather": {"w": {"missing": 3}}}, "weather.w.missing (line 5): is 3; expected 0 to 1"),
        (
            {"weather": {"w": {"effects": "dust"}}},
            "grid.yaml: weather.w: there is no effect 'dust'",
        ),
        ({"scenarios": ["gone.yaml"]}, "is not found; expected a scenario's file"),
        ({"exclude": [{"weather": "fog"}]}, "exclude[0].weather (line 4): there is no weather"),
        ({"exclude": [{"wether": "clear"}]}, "is no axis; expected 'weather'"),
        ({"exclude": [{"seed": 1}]}, "exclude: leaves no cell"),
        ({"exclude": [{}]}, "names no level"),
        ({"exclude": [{"seed": []}]}, "exclude[0].seed (line 4): names no level"),
        ({"exclude": [{"seed": "1"}]}, "there is no seed '1'; expected 1, a number"),
        ({"exclude": [{"seed": True}], "seeds": [1, 2]}, "there is no seed True"),
        ({"seeds": {"first": 2**31 - 2, "count": 3}}, "seeds (line 3): goes beyond the largest"),
        ({"rate_hz": 1000}, "rate_hz: the rig own cannot have it: Input should be less than or eq"),
        ({"rate_hz": 1000}, "equal to 100; expected a rate that every rig can have"),
        ({"storage": "zst"}, "storage (line 3): is 'zst'; expected 'zstd'"),
        ({"duration_s": 2, "start_s": 2}, "start_s (line 4): is 2; expected less than duration_s"),
        ({"split": {"shares": [0, 1]}}, "split.shares (line 4): nothing is left to train on"),
        ({"split": {"by": "scenario"}}, "split.by (line 4): divides a single site and seed"),
        ({"split": {"by": "scenario", "gap_s": 3}}, "split.gap_s (line 5): does nothing here"),
        ({"split": {"seed": 3}}, "split.seed (line 4): does nothing here"),
        ({"shards": {"format": "zip"}}, "shards.format (line 4): is 'zip'"),
        ({"seeds": {"count": 100_000}, "weather": ["clear", "fog"]}, "200000 combinations"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(
    tmp_path: Path, fields: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError) as wrong:
        steps_of(CampaignFile.read(written(tmp_path, **fields)))
    assert said in str(wrong.value)
    assert "\n" not in str(wrong.value)


@pytest.mark.parametrize(
    ("event", "said"),
    [
        ({"event": "debriss", "at_s": 1}, "events[0].event (line 3): is 'debriss'"),
        ({"event": "debris", "at_s": 1, "plaec": {}}, "expected 'place'"),
        ({"event": "debris", "at_s": 4, "place": {"x": 0, "y": 0}}, "expected less than 3 s"),
    ],
)
def test_a_scenario_is_read_before_anything_is_made(
    tmp_path: Path, event: dict[str, object], said: str
) -> None:
    (tmp_path / "odd.yaml").write_text(yaml.safe_dump({"events": [event]}))
    path = written(tmp_path, scenarios=["none", "odd.yaml"], duration_s=3)
    with pytest.raises(InputError, match=r"odd.yaml: ") as wrong:
        steps_of(CampaignFile.read(path))
    assert said in str(wrong.value)


def test_names_that_give_one_folder_are_refused(tmp_path: Path, rig: Path) -> None:
    path = written(
        tmp_path,
        rigs={"a-b": rig.name, "a": rig.name},
        weather={"c": {}, "b-c": {}},
    )
    with pytest.raises(InputError, match="would both be datasets/two-avenues-1-a-b-c-none"):
        steps_of(CampaignFile.read(path))


def test_faults_of_a_setting_are_those_of_a_study(tmp_path: Path) -> None:
    path = written(tmp_path, weather={"dirty": {"dirt_light": 0.5, "latency_s": 0.1}})
    (setting,) = CampaignFile.read(path).weather
    from urbantwin.site import load_site

    rig = setting.applied_to(load_site(EXAMPLE).rig).written()
    assert all(one["calibration"]["light"] == 0.5 for one in rig["sensors"])
    assert rig["sensors"][0]["latency_s"] == 0.1


def test_ten_thousand_cells_are_planned(tmp_path: Path) -> None:
    path = written(tmp_path, seeds={"count": 5_000}, weather=["clear", "fog"], duration_s=10)
    steps = steps_of(CampaignFile.read(path))
    assert len(steps.of("dataset")) == 10_000
    assert len({one.key for one in steps.all.values()}) == 15_001
