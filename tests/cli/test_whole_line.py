"""The whole line on the example, with small settings: every command, and what it leaves."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

Run = Callable[..., Any]

PER_HOUR = {"car": 1800, "bus": 200, "truck": 200, "bicycle": 400, "pedestrian": 900}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory, two_avenues: Path) -> Path:
    folder = tmp_path_factory.mktemp("site") / "two-avenues"
    shutil.copytree(two_avenues, folder)
    fields = yaml.safe_load((folder / "site.yaml").read_text())
    fields |= {"region": {"radius_m": 45}, "closed_loop": False}
    fields["traffic"] |= {"per_hour": PER_HOUR, "duration_s": 0.5, "warmup_s": 10}
    fields["rig"]["sensors"][0] |= {"model": "OS1-32", "columns": 512}
    fields["rig"]["sensors"][1]["model"] = "VLP-16"
    (folder / "site.yaml").write_text(yaml.safe_dump(fields))
    return folder / "site.yaml"


@pytest.fixture(scope="module")
def made(site: Path, run_once: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``urbantwin run`` leaves."""
    out = tmp_path_factory.mktemp("run") / "out"
    outcome = run_once("run", site, "-o", out, "--workers", "1", "--json")
    assert outcome.code == 0, outcome.err
    told = json.loads(outcome.out)
    assert {Path(told[kind]) for kind in ("twin", "motion", "dataset")} == set(out.iterdir())
    assert len(told["pictures"]) == 12
    assert all(Path(picture).stat().st_size > 10_000 for picture in told["pictures"])
    lines = outcome.err.splitlines()
    assert [line for line in lines if line.startswith("warning: ")] == [
        f"warning: {text}" for text in told["look_at"]
    ]
    (out.parent / "told.json").write_text(outcome.out)
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_run_leaves_the_files_of_the_document(made: Path) -> None:
    document = (Path(__file__).parents[2] / "docs" / "architecture.md").read_text()
    assert sorted(path.name for path in (made / "twin").iterdir()) == sorted(
        ["SHA256SUMS", "twin.json", "site.yaml", "rig.yaml", "elevation.npz", "lane_model.json",
         "roads.json", "network.net.xml", "scene.npz", "surface_material.npz", "colours.npz",
         "pictures"]
    )  # fmt: skip
    for folder in ("twin", "motion", "dataset"):
        for path in (made / folder).iterdir():
            assert path.name in document


def test_the_dataset_is_what_openpcdet_reads(made: Path) -> None:
    dataset = made / "dataset"
    named = [
        name
        for part in ("train", "val", "test")
        for name in (dataset / "ImageSets" / f"{part}.txt").read_text().split()
    ]
    assert len(named) == len(set(named)) == 3  # 5 steps of 0.1 s end at 0.4 s: 0, 0.2, 0.4 s
    for name in named:
        points = np.load(dataset / "points" / f"{name}.npy")
        assert points.dtype == np.float32
        assert points.shape[1] == 4
        assert (points[:, 3] >= 0).all()
        assert (points[:, 3] <= 1).all()
        semantic = np.fromfile(dataset / "semantic" / f"{name}.label", np.uint32)
        assert len(semantic) == len(points) == len(np.load(dataset / "rays" / f"{name}.npy"))
        for line in (dataset / "labels" / f"{name}.txt").read_text().splitlines():
            *numbers, category = line.split()
            assert len([float(number) for number in numbers]) == 7
            # A van may be parked, and a truck draw a trailer.
            assert category in {*PER_HOUR, "van", "trailer"}
    boxes = pq.read_table(dataset / "boxes.parquet")
    lines = sum(len(path.read_text().splitlines()) for path in (dataset / "labels").iterdir())
    assert boxes.num_rows == lines > 0


def test_nothing_names_this_machine_or_the_time(made: Path, site: Path) -> None:
    for name, content in files(made).items():
        if name.endswith((".json", ".yaml", ".xml", ".txt")):
            assert str(site.parent.parent).encode() not in content, name
            assert str(made).encode() not in content, name


def test_each_stage_alone_gives_the_bytes_of_run(
    made: Path, site: Path, run_here: Run, tmp_path: Path
) -> None:
    twin, motion, dataset = (tmp_path / name for name in ("twin", "motion", "dataset"))
    rig = tmp_path / "rig.yaml"
    rig.write_text(yaml.safe_dump(yaml.safe_load(site.read_text(encoding="utf-8"))["rig"]))
    for arguments in (
        ("build", site, "-o", twin, "--no-pictures"),
        ("drive", twin, "-o", motion, "--seconds", "0.5", "--seed", "1", "--no-pictures"),
        ("record", twin, motion, "--rig", rig, "-o", dataset, "--workers", "1", "--no-pictures"),
    ):
        outcome = run_here(*arguments, "--quiet")
        assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    for folder in (twin, motion, dataset):
        mine = files(folder)
        theirs = {
            name: content
            for name, content in files(made / folder.name).items()
            if not name.startswith("pictures/")
        }
        for one in (mine, theirs):
            sums = one["SHA256SUMS"].splitlines(keepends=True)
            beside = (b"  pictures/", b"  README.md")  # the card shows the pictures
            one["SHA256SUMS"] = b"".join(
                line for line in sums if not any(name in line for name in beside)
            )
            sections = one.get("README.md", b"").split(b"\n## ")
            one["README.md"] = b"\n## ".join(
                text.rstrip() for text in sections if not text.startswith(b"Pictures")
            )
        assert mine.keys() == theirs.keys()
        assert [name for name in mine if mine[name] != theirs[name]] == []


@pytest.mark.parametrize("kind", ["twin", "motion", "dataset"])
def test_inspect_agrees_with_the_files(made: Path, run_here: Run, kind: str) -> None:
    told = json.loads(run_here("info", made / kind, "--json").out)
    assert told["kind"] == kind
    if kind == "twin":
        with np.load(made / "twin" / "scene.npz") as scene:
            assert told["triangles"] == len(scene["faces"])
        assert sum(told["triangles_by_class"].values()) == told["triangles"]
    elif kind == "motion":
        table = pq.read_table(made / "motion" / "actors.parquet")
        assert told["poses"] == table.num_rows
        assert sum(told["actors"].values()) == len(table["track"].unique())
    else:
        points = [np.load(path) for path in (made / "dataset" / "points").iterdir()]
        assert told["points"] == sum(map(len, points))
        assert told["frames"] == len(points)
    assert run_here("info", made / kind).out.startswith(f"path: {made / kind}\nkind: {kind}\n")


def test_run_sums_up_what_the_files_hold(made: Path) -> None:
    told = json.loads((made.parent / "told.json").read_text())
    boxes = pq.read_table(made / "dataset" / "boxes.parquet").to_pandas()
    boxes = boxes[~boxes["ignored"].isin(["outside", "far"])]
    for kind, share in told["objects_with_points"].items():
        mine = boxes[boxes["class"] == kind]
        assert share == pytest.approx((mine["num_points"] > 0).mean(), abs=5e-4)
    assert set(told["objects_with_points"]) == set(boxes["class"])
    actors = pq.read_table(made / "motion" / "actors.parquet")
    assert sum(told["actors"].values()) == len(actors["track"].unique())
    roads = json.loads((made / "twin" / "roads.json").read_text())
    assert (told["roads"], told["lanes"]) == (len(roads["roads"]), len(roads["lanes"]))
    kept = [
        warning
        for kind in ("twin", "motion", "dataset")
        for warning in json.loads((made / kind / f"{kind}.json").read_text())["warnings"]
    ]
    assert len(kept) == len(told["look_at"])
    for warning, line in zip(kept, told["look_at"], strict=True):
        assert line.startswith(f"{warning['about']}: {warning['problem']}")


def test_inspect_tells_a_whole_run(made: Path, run_here: Run) -> None:
    told = json.loads(run_here("info", made, "--json").out)
    assert told["kind"] == "run"
    assert {"twin", "motion", "dataset"} <= told.keys()


def test_a_changed_twin_is_refused(made: Path, run_here: Run, tmp_path: Path) -> None:
    twin = tmp_path / "twin"
    shutil.copytree(made / "twin", twin)
    (twin / "network.net.xml").write_text("<net/>")
    outcome = run_here("drive", twin, "-o", tmp_path / "motion")
    assert outcome.code == 2
    assert outcome.err.startswith(f"error: {twin / 'network.net.xml'}: ")
    assert not (tmp_path / "motion").exists()


def test_compare_finds_a_dataset_nearest_to_itself(
    made: Path, run_here: Run, tmp_path: Path
) -> None:
    points = np.load(made / "dataset" / "points" / "000000.npy")[::40]
    for name, shift in (("real", 0.0), ("same", 0.0), ("moved", 3.0)):
        (tmp_path / name).mkdir()
        np.save(tmp_path / name / "0.npy", points + np.array([shift, 0, 0, 0], np.float32))
    real, same, moved = (tmp_path / name for name in ("real", "same", "moved"))
    outcome = run_here(
        "compare", real, same, "-o", tmp_path / "report", "--arbitrary", moved, "--json"
    )
    assert outcome.code == 0, outcome.err
    figures = json.loads(outcome.out)["mean_over_frames"]
    assert figures["hausdorff_p95_m"]["synthetic"] == 0.0
    # A shift of 3 m moves no point farther than 3 m from where another was.
    assert 0.0 < figures["hausdorff_p95_m"]["arbitrary"] <= 3.0 + 1e-4
    assert (tmp_path / "report" / "report.png").stat().st_size > 10_000
