"""The card of a dataset: figures, pictures, licences, texts of strangers; nothing is lost."""

import json
import os
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from markdown_it import MarkdownIt

import urbantwin as ut
from urbantwin.artefact import sha256_of, verify, write_inventory, write_json
from urbantwin.cli import main
from urbantwin.dataset import record
from urbantwin.dataset.card import PICTURES, read_statistics, write_cards
from urbantwin.dataset.card.licences import consequences, hub_licence
from urbantwin.drawing.box_figures import pictures_of_boxes
from urbantwin.errors import InputError

READER = MarkdownIt("commonmark").enable("table")


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(dataset, tmp_path / "copy")


def rows_under(card: str, title: str) -> list[list[str]]:
    """The cells of the first table under a title."""
    html = READER.render(card.partition(f"\n## {title}\n")[2].partition("\n## ")[0])
    body = html.partition("<tbody>")[2].partition("</tbody>")[0]
    return [
        [re.sub("<[^>]+>", "", cell) for cell in re.findall("<td[^>]*>(.*?)</td>", row)]
        for row in re.findall("<tr>(.*?)</tr>", body, re.DOTALL)
    ]


def changed(folder: Path, **fields: object) -> None:
    manifest = json.loads((folder / "dataset.json").read_text())
    write_json(folder / "dataset.json", {**manifest, **fields})
    write_inventory(folder)


def test_record_leaves_a_card_whose_figures_are_those_of_the_tables(dataset: Path) -> None:
    card = (dataset / "README.md").read_text()
    boxes = pq.read_table(dataset / "boxes.parquet").to_pylist()
    told = {row[0]: row for row in rows_under(card, "Classes")}
    assert set(told) == {one["class"] for one in boxes}
    for name, row in told.items():
        mine = [one for one in boxes if one["class"] == name]
        seen = [one for one in mine if one["num_points"]]
        assert row[1:4] == [str(len(mine)), str(len(seen)), str(len({o["track"] for o in mine}))]
        lengths = [
            np.median([one["length"] for one in mine if one["track"] == track])
            for track in {one["track"] for one in mine}
        ]
        assert float(row[5]) == pytest.approx(np.median(lengths), abs=0.006)
        if seen:
            assert float(row[8]) == pytest.approx(
                np.median([one["num_points"] for one in seen]), abs=0.51
            )
    splits = {row[0]: row for row in rows_under(card, "Split")}
    for name in ("train", "val"):
        frames = (dataset / "ImageSets" / f"{name}.txt").read_text().split()
        assert splits[name][1] == str(len(frames))
        assert splits[name][3] == str(sum(one["frame"] in frames for one in boxes))
    points = sum(int(row[1].replace(",", "")) for row in rows_under(card, "Points"))
    assert points == sum(len(np.load(one)) for one in (dataset / "points").iterdir())
    assert rows_under(card, "Sensors")[0][1] == "VLP-16"
    assert sha256_of(dataset / "dataset.json") in card
    assert not verify(dataset)[0].damages


def test_distances_are_those_from_the_sensor(dataset: Path, rig) -> None:
    statistics = read_statistics(dataset)
    eye = rig.sensors[0].site_SE3_sensor.translation[:2]
    away = np.hypot(*(statistics.site_xy - eye).T)
    assert np.allclose(statistics.range_m, away, atol=0.01)


def test_a_hub_reads_the_front_matter(dataset: Path) -> None:
    _, front, _ = (dataset / "README.md").read_text().split("---\n", 2)
    told = yaml.safe_load(front)
    assert told["license"] == "odbl"
    assert told["pretty_name"] == "test"
    assert told["size_categories"] == ["n<1K"]
    assert "object-detection" in told["task_categories"]


def test_strangers_texts_break_neither_tables_nor_html(copy: Path) -> None:
    nasty = "a | b <img src=x onerror=alert(1)> [c](http://d) *e* `f` \n\n# g"
    changed(
        copy,
        inputs=[{"kind": "osm", "name": nasty, "licence": nasty, "attribution": nasty}],
        about={
            "place": nasty,
            "ground": nasty,
            "traffic": {"classes": {nasty: {"seen": 1}}, "recorded": {"smoothing": nasty}},
            "warnings": {"twin": [{"about": nasty, "problem": nasty}], "motion": 3},
        },
    )
    write_cards(copy)
    card = (copy / "README.md").read_text()
    body = card.split("---\n", 2)[2]
    html = READER.render(body)
    ours = "h1|h2|p|ul|li|code|table|thead|tbody|tr|th|td|pre|em|strong"
    assert not re.findall(rf"<(?!/?(?:{ours})[ />])", html)
    assert html.count("<h1>") == 1
    assert "# g" not in re.findall("^# .*", body, re.MULTILINE)
    (row,) = rows_under(body, "Inputs, licences and attribution")
    assert len(row) == 5
    assert yaml.safe_load(card.split("---\n", 2)[1])["license"] == "other"


@pytest.mark.parametrize(
    "about", [None, 7, [], {"traffic": [1]}, {"warnings": {"twin": "a"}}, {"place": {"a": 1}}]
)
def test_a_manifest_of_another_version_has_a_card(copy: Path, about: object) -> None:
    changed(copy, about=about, layout=None, dependencies=[1], made_from=None, warnings=7)
    write_cards(copy)
    assert "## Known limits" in (copy / "README.md").read_text()


def test_the_card_is_written_anew_in_the_dataset_and_nothing_else_changes(copy: Path) -> None:
    (copy / "README.md").unlink()
    write_inventory(copy)
    before = {path: path.stat().st_ino for path in copy.rglob("*") if path.is_file()}
    made = ut.dataset.card(copy, progress=False)
    assert str(made) == (copy / "README.md").read_text()
    assert not verify(copy)[0].damages
    for name in PICTURES:
        linked = f"](pictures/{name})" in str(made)
        assert linked == (copy / "pictures" / name).is_file() == (name != "scene.png")
    for path, number in before.items():
        if path.name != "SHA256SUMS":
            assert path.stat().st_ino == number, path
    again = ut.dataset.card(copy, progress=False)
    assert str(again) == str(made)
    assert [one.name for one in copy.parent.iterdir()] == ["copy"]


def test_pictures_are_not_drawn_over_those_of_the_older_dataset(copy: Path) -> None:
    """Their files have two names for a while: what is drawn into one would be in both."""
    (copy / "pictures").mkdir()
    old = copy / "pictures" / "birdseye.png"
    old.write_bytes(b"old")
    os.link(old, copy.with_name("kept.png"))
    write_inventory(copy)
    ut.dataset.card(copy, progress=False)
    assert copy.with_name("kept.png").read_bytes() == b"old"
    assert old.read_bytes().startswith(b"\x89PNG")
    assert not verify(copy)[0].damages


def test_the_card_does_not_depend_on_where_or_by_whom_it_is_written(
    dataset: Path, copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LOGNAME", "pole")
    monkeypatch.chdir(tmp_path)
    assert main(["dataset", "card", "copy", "-o", "elsewhere", "--no-pictures", "--quiet"]) == 0
    assert (tmp_path / "elsewhere" / "README.md").read_bytes() == (
        dataset / "README.md"
    ).read_bytes()
    assert (copy / "README.md").read_bytes() == (dataset / "README.md").read_bytes()
    assert not verify(tmp_path / "elsewhere")[0].damages


def test_what_a_person_wrote_is_not_lost(copy: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (copy / "notes.txt").write_text("mine")
    assert main(["dataset", "card", str(copy), "--no-pictures", "-q"]) == 2
    assert "notes.txt" in capfd.readouterr().err
    (copy / "notes.txt").unlink()
    (copy / "README.md").write_text("my own words")
    assert main(["dataset", "card", str(copy), "--no-pictures", "-q"]) == 2
    assert "changed by hand" in capfd.readouterr().err
    assert (copy / "README.md").read_text() == "my own words"
    (copy / "SHA256SUMS").unlink()
    assert main(["dataset", "card", str(copy), "--no-pictures", "-q"]) == 2
    assert "-o" in capfd.readouterr().err
    assert (
        main(["dataset", "card", str(copy), "--no-pictures", "-q", "-o", str(copy / "card")]) == 2
    )
    assert "inside" in capfd.readouterr().err


def test_damage_stays_known_when_the_card_is_written_anew(copy: Path) -> None:
    frame = copy / "points" / "000003.npy"
    data = bytearray(frame.read_bytes())
    data[-1] ^= 1
    frame.write_bytes(data)
    ut.dataset.card(copy, pictures=False, progress=False)
    assert [one.name for one in verify(copy)[0].damages] == ["points/000003.npy"]


@pytest.mark.thorough
def test_killed_before_every_change_of_the_disk(dataset: Path, tmp_path: Path) -> None:
    """The dataset is the older or the new one, whole; the next run leaves no rubbish."""
    for n in (*range(1, 20), 30, 50, 500):
        place = tmp_path / str(n)
        folder = shutil.copytree(dataset, place / "data", copy_function=os.link)
        (folder / "README.md").unlink()
        (folder / "SHA256SUMS").unlink()
        write_inventory(folder)
        process = os.fork()
        if not process:
            with killed_at(n):
                ut.dataset.card(folder, pictures=False, progress=False)
            os._exit(0)
        ended = os.waitpid(process, 0)[1]
        assert not verify(folder)[0].damages, n
        assert len(list((folder / "points").iterdir())) == len(list((dataset / "points").iterdir()))
        ut.dataset.card(folder, pictures=False, progress=False)
        assert not verify(folder)[0].damages, n
        assert [one.name for one in place.iterdir()] == ["data"]
        assert (folder / "README.md").read_bytes() == (dataset / "README.md").read_bytes()
        assert (ended == 0) == (n == 500)
        shutil.rmtree(place)


@contextmanager
def killed_at(n: int) -> Iterator[None]:
    """Kill this process before the n-th change of the disk, links aside: there are many."""
    count = 0

    def change(event: str, arguments: tuple[object, ...]) -> None:
        nonlocal count
        writes = event == "open" and isinstance(arguments[2], int) and arguments[2] & os.O_ACCMODE
        if writes or event in ("os.rename", "os.mkdir", "os.remove", "os.rmdir"):
            count += 1
            if count == n:
                os._exit(9)

    sys.addaudithook(change)
    yield


def test_a_folder_of_datasets_has_a_card_for_each(twin, motion, rig, copy: Path) -> None:
    other = copy.with_name("other")
    record(twin, motion, rig, other, workers=1, seed=6, stop_s=0.3)
    made = ut.dataset.card(
        copy.parent, copy.parent.with_name("cards"), pictures=False, progress=False
    )
    assert [one.relative_to(made.path.with_name("cards")).as_posix() for one in made.files] == [
        "copy/README.md",
        "other/README.md",
        "README.md",
    ]
    links = re.findall(r"\]\(([^)]+)\)", str(made))
    assert links == ["copy/README.md", "other/README.md"]
    assert all((made.files[-1].parent / one).is_file() for one in links)
    with pytest.raises(InputError, match="holds no dataset"):
        ut.dataset.card(copy / "points", progress=False)


def test_an_exported_dataset_has_a_card(tmp_path: Path) -> None:
    folder = tmp_path / "kitti"
    folder.mkdir()
    told = {
        "kind": "exported",
        "format": "kitti",
        "urbantwin": "0.1.0",
        "dataset_sha256": "ab" * 32,
        "inputs": [{"kind": "osm", "name": "a.osm", "licence": "ODbL-1.0", "attribution": "x"}],
        "losses": ["tracks | are lost"],
        "notes": [],
    }
    write_json(folder / "exported.json", told)
    made = ut.dataset.card(folder, tmp_path / "card", progress=False)
    assert "tracks \\| are lost" in str(made)
    assert "4.4" in str(made)
    # An input whose kind is no word is one of an unknown kind.
    write_json(folder / "exported.json", {**told, "inputs": [{**told["inputs"][0], "kind": ["a"]}]})
    assert "a.osm" in str(ut.dataset.card(folder, tmp_path / "card", progress=False))
    write_json(folder / "exported.json", {**told, "inputs": 7})
    with pytest.raises(InputError, match="inputs"):
        ut.dataset.card(folder, tmp_path / "card", progress=False)


@pytest.mark.parametrize(
    ("licences", "hub", "words"),
    [
        (["ODbL-1.0"], "odbl", "derivative database"),
        (["CC BY-NC-SA 3.0"], "other", "commercial"),
        (["CC-BY-4.0"], "cc-by-4.0", "name the author"),
        (["CC-BY"], "other", "name the author"),
        (["ODbL-1.0", "not stated"], "unknown", "without a licence"),
        (["CC0-1.0", "ODbL-1.0"], "odbl", "nothing"),
        (["ODbL-1.0", "CC BY 4.0"], "other", "name the author"),
        (["My own terms"], "other", "read it"),
        ([], "unknown", ""),
    ],
)
def test_licences_and_what_follows(licences: list[str], hub: str, words: str) -> None:
    inputs = [{"name": "a", "licence": one} for one in licences]
    assert hub_licence(inputs) == hub
    assert words in " ".join(text for _, text in consequences(inputs))
    assert len(consequences(inputs)) == len(set(licences))


def test_a_dataset_without_anybody_has_a_card_and_pictures(
    twin, motion, rig, tmp_path: Path
) -> None:
    out = tmp_path / "empty"
    record(twin, motion, rig, out, workers=1, seed=5, stop_s=0.1)
    assert "No box of" in (out / "README.md").read_text()
    drawn = pictures_of_boxes(read_statistics(out), {"train": ["000000"]}, tmp_path / "pictures")
    assert all(path.stat().st_size > 5000 for path in drawn)


@pytest.mark.parametrize("command", [["card"], ["split", "--shares", "80,20"]])
def test_a_damaged_table_is_told_by_its_own_name(
    copy: Path, capfd: pytest.CaptureFixture[str], command: list[str]
) -> None:
    with (copy / "sweeps.parquet").open("r+b") as stream:
        stream.truncate(500)
    assert main(["dataset", command[0], str(copy), *command[1:], "--quiet"]) == 2
    said = capfd.readouterr().err
    assert said.startswith(f"error: {copy / 'sweeps.parquet'}: is not readable")
