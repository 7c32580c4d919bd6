"""The command, from a twin and a motion on disk to rigs that record; and what it refuses."""

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest
import yaml

import urbantwin as ut
from urbantwin.cli import main
from urbantwin.lidar import place_rig
from urbantwin.site import load_rig_spec
from urbantwin.studies.placement.measure import MEASURES
from urbantwin.studies.placement.place import ask
from urbantwin.studies.placement.place_file import PlaceSpec, load_place_spec
from urbantwin.taxonomy import semantic_id

from ...thorough import further
from ...whole_page import whole_page
from .conftest import SPEC


@pytest.fixture(scope="module")
def folder(two_avenues_twin, motion, tmp_path_factory):
    """A folder with the motion and a wish; the twin is elsewhere."""
    place = tmp_path_factory.mktemp("placement")
    motion.save(place / "motion")
    (place / "place.yaml").write_text(yaml.safe_dump(SPEC))
    return place


@pytest.fixture(scope="module")
def placement(two_avenues_twin, folder):
    return ut.rig.place(
        two_avenues_twin.folder, folder / "motion", folder / "one", wish=folder / "place.yaml",
        layouts=8, workers=1, progress=False,
    )  # fmt: skip


def bytes_of(folder: Path) -> dict[str, bytes]:
    return {
        str(one.relative_to(folder)): one.read_bytes()
        for one in sorted(folder.rglob("*"))
        if one.is_file()
    }


@pytest.mark.thorough
@pytest.mark.parametrize("workers", [1, *further(2)])
def test_an_interrupted_run_leaves_the_same_bytes_whoever_goes_on(
    two_avenues_twin, folder, placement, monkeypatch, workers
):
    from urbantwin.studies.placement import sighting

    whole, written = sighting.write_sighting, []

    def dies_at_the_third(path, made):
        if len(written) == 2:
            raise KeyboardInterrupt
        written.append(path)
        whole(path, made)

    out = folder / f"by-{workers}"
    arguments = (two_avenues_twin.folder, folder / "motion", out)
    options = {"wish": folder / "place.yaml", "layouts": 8, "progress": False}
    with monkeypatch.context() as patch:
        patch.setattr(sighting, "write_sighting", dies_at_the_third)
        with pytest.raises(KeyboardInterrupt):
            ut.rig.place(*arguments, workers=1, **options)
    assert not out.exists()
    left = [one for one in folder.iterdir() if one.name.endswith("urbantwin-partial")]
    assert len(list((left[0] / "casts").glob("view-*.npz"))) == 2
    ut.rig.place(*arguments, workers=workers, **options)
    assert bytes_of(out) == bytes_of(placement.folder)
    assert not [one for one in folder.iterdir() if one.name.endswith("urbantwin-partial")]


def test_tables_agree_with_each_other_and_with_rigs(two_avenues_twin, placement):
    layouts = placement.layouts
    assert layouts.num_rows == placement.manifest["layouts"] == 8
    assert set(MEASURES) <= set(layouts.column_names)
    for name in ("layouts", "sensors", "hidden", "points", "candidates"):
        table = pq.read_table(placement.folder / f"{name}.parquet")
        read = pa_csv.read_csv(placement.folder / f"{name}.csv")
        assert read.column_names == table.column_names
        assert read.num_rows == table.num_rows
    sensors = pq.read_table(placement.folder / "sensors.parquet").to_pylist()
    front = [row["layout"] for row in layouts.to_pylist() if row["front"]]
    assert len(front) == len(placement.rigs) > 0
    for path in placement.rigs:
        number = int(path.stem.split("-")[1])
        assert number in front
        spec = load_rig_spec(path)
        place_rig(spec, two_avenues_twin.mesh)
        told = [row for row in sensors if row["layout"] == number]
        assert [(one.east_m, one.north_m, one.height_m, one.pitch_deg) for one in spec.sensors] == [
            (row["east_m"], row["north_m"], row["height_m"], row["tilt_deg"]) for row in told
        ]
    for row in layouts.to_pylist():
        assert row["seen_50"] <= row["seen_20"] <= row["seen_5"]
        assert row["seen_5_one_failed"] <= row["seen_5"]
        assert row["seen_20_low"] <= row["seen_20"] <= row["seen_20_high"]


def test_the_page_holds_the_front_and_needs_no_other_file(placement):
    page = whole_page((placement.folder / "report.html").read_text())
    cells = {cell.strip() for cell in page.cells}
    assert set(MEASURES) <= cells
    text = " ".join(page.texts)
    hidden = placement.hidden.to_pylist()
    for path in placement.rigs:
        assert f"rigs/{path.name}" in text
        number = int(path.stem.split("-")[1])
        for sensor in load_rig_spec(path).sensors:
            assert sensor.model in cells
        missed = [row for row in hidden if row["layout"] == number]
        assert {f"{row['class']} {row['track']}" for row in missed[:1]} <= cells
    tags = [tag for tag, _ in page.tags]
    assert tags.count("details") == len(placement.rigs) + 1
    assert tags.count("img") == 2


def test_a_placement_opens_and_is_whole(placement):
    opened = ut.open(placement.folder)
    assert isinstance(opened, ut.rig.Placement)
    assert opened.summary()["front"]
    assert "8 layouts" in repr(opened)
    assert ut.dataset.verify(placement.folder)


@pytest.mark.thorough
def test_default_candidates_are_free_and_hang_on_what_they_say(two_avenues_twin, motion):
    spec = PlaceSpec.model_validate({"candidates": {"most": 3}})
    question = ask(two_avenues_twin, motion, spec, layouts=1, seed=0)
    mesh = two_avenues_twin.mesh
    found = question.mounts.every
    assert {one.kind for one in found} == {"pole", "signal", "facade", "new-pole"}
    near = {"pole": "pole", "signal": "pole", "facade": "building"}
    for one in found:
        assert np.hypot(one.east_m, one.north_m) <= spec.candidates.within_m + 1
        if one.kind in near:
            corners = mesh.vertices[
                np.unique(mesh.faces[mesh.semantic == semantic_id(near[one.kind])])
            ]
            if one.kind != "facade":
                away = np.linalg.norm(corners[:, :2] - [one.east_m, one.north_m], axis=1)
                assert away.min() < 0.7
    rig = question.views.rig_spec(tuple(range(0, len(question.views.every), 7)))
    place_rig(rig, mesh)


def wish(changes: dict) -> dict:
    merged = json.loads(json.dumps(SPEC))
    for key, value in changes.items():
        if key == "places":
            merged["candidates"]["places"] = value
        elif key == "candidates":
            merged["candidates"] = value
        else:
            merged[key] = value
    return merged


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"models": [{"model": "OS1-129", "price": 1}]}, ("models[0].model", "OS1-129")),
        ({"models": [{"model": "VLP-16", "price": -1}]}, ("models[0].price",)),
        ({"models": [{"model": "VLP-16", "price": 1, "columns": 7}]}, ("models[0].columns", "7")),
        ({"models": []}, ("models",)),
        ({"budget": 100, "sensors": {"least": 2, "most": 2}}, ("budget", "9600")),
        ({"sensors": {"least": 3, "most": 2}}, ("sensors", "at most 2")),
        ({"sensors": {"least": 6, "most": 6}}, ("sensors.least", "5")),
        ({"objectives": ["beauty"]}, ("objectives", "beauty")),
        ({"objectives": ["cost", "cost"]}, ("objectives", "twice")),
        ({"heights_m": [-2.0]}, ("heights_m", "under the ground")),
        ({"heights_m": [float("nan")]}, ("heights_m",)),
        ({"places": [{"name": "a", "east_m": 900.0, "north_m": 0.0}]}, ("places[0]", "no ground")),
        ({"places": [{"name": "a", "east_m": 38.0, "north_m": 34.0}]}, ("places[0]", "building")),
        ({"places": [{"name": "a", "east_m": 1.0, "north_m": 0.0}] * 2}, ("places", "'a'")),
        ({"candidates": {"kinds": []}}, ("candidates", "no place")),
        ({"candidates": {"kinds": ["tower"]}}, ("kinds[0]", "tower")),
        ({"candidates": {"kinds": ["new-pole"], "area": [[0, 0], [1, 1]]}}, ("area",)),
        (
            {"candidates": {"kinds": ["new-pole"], "area": [[900, 0], [910, 0], [905, 9]]}},
            ("candidates.area", "m from the middle"),
        ),
        (
            {"candidates": {"kinds": ["new-pole"], "area": [[0, 0], [9, 9], [9, 0], [0, 9]]}},
            ("area", "crosses itself"),
        ),
        ({"candidates": {"kinds": ["new-pole"], "area": [[0, 0], [4, 4], [9, 9]]}}, ("area",)),
        ({"candidates": {"kinds": ["pole"], "area": [[0, 0], [9, 0], [9, 9]]}}, ("new-pole",)),
        ({"colour": "red"}, ("colour",)),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused_before_anything_is_cast(
    two_avenues_twin, motion, tmp_path, changes, named
):
    file = tmp_path / "place.yaml"
    file.write_text(yaml.safe_dump(wish(changes)))
    with pytest.raises(ut.InputError) as caught:
        ask(two_avenues_twin, motion, load_place_spec(file), layouts=5, seed=0, file=file)
    said = str(caught.value)
    assert said.startswith(str(file))
    for word in named:
        assert word in said


def test_a_refusal_is_one_line_and_leaves_nothing(two_avenues_twin, folder, tmp_path, capfd):
    file = tmp_path / "place.yaml"
    file.write_text(yaml.safe_dump(wish({"budget": 4799})))
    code = main(
        ["rig", "place", str(two_avenues_twin.folder), str(folder / "motion"),
         "-o", str(tmp_path / "out"), "--wish", str(file), "--quiet"]
    )  # fmt: skip
    said = capfd.readouterr().err
    assert code == 2
    assert said.startswith("error: ")
    assert said.count("\n") == 1
    assert "the cheapest costs 4800" in said
    assert [one.name for one in tmp_path.iterdir()] == ["place.yaml"]


def test_a_motion_of_another_twin_is_refused(two_avenues_twin, folder, tmp_path, capfd):
    shutil.copytree(folder / "motion", tmp_path / "motion")
    told = json.loads((tmp_path / "motion" / "motion.json").read_text())
    told["twin_sha256"] = "0" * 64
    (tmp_path / "motion" / "motion.json").write_text(json.dumps(told))
    code = main(["rig", "place", str(two_avenues_twin.folder), str(tmp_path / "motion"),
                 "-o", str(tmp_path / "out"), "--quiet"])  # fmt: skip
    assert code == 2
    assert "another twin" in capfd.readouterr().err
