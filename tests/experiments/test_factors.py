"""What factors do to a rig, and which files of studies are refused."""

from pathlib import Path

import pytest
import yaml

from urbantwin.errors import InputError
from urbantwin.experiments.grid import Axis
from urbantwin.experiments.study.factors import FACTORS, FactorAsked, rig_at
from urbantwin.experiments.study.file import StudyFile, check_rigs
from urbantwin.site import RigSpec

SENSOR = {"model": "VLP-16", "east_m": 1.0, "north_m": 2.0, "height_m": 4.0}
RIG = RigSpec.model_validate({"sensors": [{"name": name, **SENSOR} for name in ("a", "b", "c")]})


def at(name: str, level: object, base: object = 0, **more: object) -> RigSpec:
    asked = FactorAsked(Axis(name, (base, level)), **more)  # type: ignore[arg-type]
    return rig_at(RIG, [asked], {name: level})  # type: ignore[dict-item]


def test_the_base_levels_of_all_faults_leave_the_rig_as_it_is() -> None:
    usual = {"outage_unit": "none", "dirt_light": 1.0, "traffic_density": 1.0}
    usual |= {f"{air}_visibility_m": "none" for air in ("rain", "fog", "snow")}
    for name, factor in FACTORS.items():
        rig = at(name, usual.get(name, 0), "base").written()
        plain = RIG.written()
        if factor.by_clock:
            assert rig.pop("frames_by") == "clock"
            plain.pop("frames_by")
        for one in rig["sensors"]:
            if name == "sway_m":  # no sway at all where the root mean square is 0
                assert one.pop("sway")["rms_m"] == 0
            if name.startswith("pose_"):
                told = one.pop("pose_error")
                assert {told[key] for key in told if key != "memory_s"} == {0.0}
        assert rig == plain, name


@pytest.mark.parametrize(
    ("name", "level", "field", "values"),
    [
        ("sync_jitter_s", 0.02, "time_jitter_s", [0.02] * 3),
        ("clock_offset_s", 0.1, "clock_offset_s", [0.1, -0.1, 0.1]),
        ("clock_drift_ppm", 20, "clock_offset_s", [0.072, -0.072, 0.072]),
        ("clock_drift_ppm", 20, "clock_drift_ppm", [20, -20, 20]),
        ("latency_s", 0.2, "latency_s", [0.2, 0, 0]),
        ("dropped_frames", 0.1, "dropped_frames", [0.1] * 3),
    ],
)
def test_a_factor_sets_its_field_of_its_sensors(
    name: str, level: float, field: str, values: list[float]
) -> None:
    assert [getattr(one, field) for one in at(name, level).sensors] == pytest.approx(values)


def test_faults_add_to_what_the_rig_has() -> None:
    named = at("dirt_light", 0.5, 1.0, sensors=("b",))
    assert [one.calibration.light for one in named.sensors] == [1.0, 0.5, 1.0]
    sector = at("outage_sector_deg", 90).sensors
    assert [one.outages[0].sector_deg for one in sector if one.outages] == [[-45.0, 45.0]]
    assert at("outage_sector_deg", 360).sensors[0].outages[0].sector_deg is None
    out = at("outage_unit", "b", "none").sensors
    assert [len(one.outages) for one in out] == [0, 1, 0]
    rain = at("rain_visibility_m", 300, "none").conditions
    assert (rain.weather, rain.visibility_m) == ("rain", 300.0)
    pose = at("pose_error_m", 0.2, sensors=("c",), memory_s=5.0).sensors
    assert [one.pose_error is None for one in pose] == [True, True, False]
    assert pose[2].pose_error is not None
    assert (pose[2].pose_error.rms_m, pose[2].pose_error.memory_s) == (0.2, 5.0)


def written(folder: Path, **fields: object) -> Path:
    (folder / "twin").mkdir(exist_ok=True)
    usual = {"twin": "twin", "seeds": [1, 2], "factors": {"sway_m": [0, 0.01]}}
    path = folder / "grid.yaml"
    kept = {key: value for key, value in {**usual, **fields}.items() if value != "left out"}
    path.write_text(yaml.safe_dump(kept, sort_keys=False))
    return path


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"factors": {"sync_jiter_s": [0, 1]}}, "factors.sync_jiter_s (line 6)"),
        ({"factors": {"sync_jiter_s": [0, 1]}}, "expected 'sync_jitter_s'"),
        ({"factors": {"sway_m": [0, 3]}}, "has the level 3; expected 0 to 1"),
        ({"factors": {"sway_m": [0, "much"]}}, "has the level 'much'; expected 0 to 1"),
        ({"factors": {"fog_visibility_m": ["none", 5]}}, "expected 10 to 100000, or none"),
        ({"factors": {"sway_m": [0, 0.01, 0.0]}}, "has the level 0.0 twice; expected each level"),
        ({"factors": {"sway_m": [0]}}, "has one level; expected a base and another"),
        ({"factors": {"sway_m": []}}, "is empty"),
        ({"factors": {"sway_m": 0.1}}, "is no list of levels"),
        ({"factors": {"sway_m": {"levels": [0, 1], "sensor": ["a"]}}}, "factors.sway_m.sensor"),
        ({"factors": {"sway_m": [False, True]}}, "factors.sway_m"),
        ({"factors": {}}, "factors"),
        ({"factors": "left out"}, "factors: is missing"),
        ({"seeds": []}, "seeds (line 2): is empty"),
        ({"seeds": "left out"}, "seeds: is missing; expected seeds of the motions"),
        ({"seeds": [3, 3]}, "names a seed twice"),
        ({"twin": "nowhere"}, "nowhere' is not found"),
        ({"model": "nowhere"}, "nowhere' is not found"),
        ({"design": "latin square"}, "design"),
        ({"classes": ["cra"]}, "expected 'car'"),
        ({"train": {"steps": 10, "seeds": [2, 5]}}, "has 2, which judges, too"),
        ({"train": {"steps": 10}}, "is missing; expected seeds of motions to learn from"),
        ({"seconds": 5, "start": 6}, "start (line 10): is 6; expected less than seconds, 5"),
    ],
)
def test_a_study_that_is_wrong_is_refused_in_one_line(
    tmp_path: Path, fields: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError) as refused:
        StudyFile.read(written(tmp_path, **fields))
    assert said in str(refused.value), refused.value
    assert "grid.yaml" in str(refused.value)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({"outage_unit": ["none", "aa"]}, "there is no sensor 'aa' in the rig; expected 'a'"),
        ({"sway_m": {"levels": [0, 1], "sensors": ["d"]}}, "there is no sensor 'd' in the rig"),
        (
            {"rain_visibility_m": ["none", 300], "fog_visibility_m": ["none", 200]},
            "fog and rain at once",
        ),
    ],
)
def test_levels_that_a_rig_cannot_have_are_refused(
    tmp_path: Path, factors: dict[str, object], said: str
) -> None:
    study = StudyFile.read(written(tmp_path, factors=factors, design="factorial"))
    with pytest.raises(InputError, match=said):
        check_rigs(study, RIG)


def test_one_cell_for_every_level_or_combination(tmp_path: Path) -> None:
    factors = {"sway_m": [0, 0.01, 0.02], "latency_s": [0, 0.1]}
    assert len(check_rigs(StudyFile.read(written(tmp_path, factors=factors)), RIG)) == 4
    both = StudyFile.read(written(tmp_path, factors=factors, design="factorial"))
    rigs = check_rigs(both, RIG)
    assert len(rigs) == 6
    assert [one.sensors[0].latency_s for one in rigs] == [0, 0.1] * 3
