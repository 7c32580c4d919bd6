"""What a whole line leaves, from a site with absolute paths: nothing of where it was made."""

from pathlib import Path

import pytest

import urbantwin as ut
from urbantwin.artefact.privacy import search_files

from .conftest import Line


@pytest.mark.parametrize("kind", ["twin", "motion", "dataset"])
def test_an_artefact_says_nothing_of_where_and_by_whom_it_was_made(line: Line, kind: str) -> None:
    folder = getattr(line, kind).folder
    names = {str(line.site.parent): "folder", folder.parents[2].name: "folder"}
    assert search_files(folder, names=names) == []
    found = ut.dataset.verify(folder, privacy=True, progress=False)
    assert found
    assert found.personal == ()


@pytest.mark.parametrize("to", ["opendrive", "sumo", "geojson", "glb", "plan"])
def test_neither_does_an_export(line: Line, tmp_path: Path, to: str) -> None:
    names = {str(line.site.parent): "folder", str(tmp_path): "folder"}
    made = ut.export(line.twin, to, tmp_path / f"a.{'xodr' if to == 'opendrive' else to}")
    assert search_files(made.path, names=names) == []


def test_whoever_wrote_a_name_into_a_dataset_is_told(line: Line, tmp_path: Path) -> None:
    (tmp_path / "notes.md").write_text("by jane.doe@example.org in /home/jane/data/run3\n")
    found = ut.dataset.verify(tmp_path, privacy=True, progress=False)
    assert not found
    assert {one.what for one in found.personal or ()} == {"e-mail address", "absolute path"}
    with pytest.raises(ut.InputError, match=r"notes\.md: line 1 \(byte 27\): absolute path"):
        found.check()
    assert found.summary()["personal_findings"] == len(found.personal)
    assert found.summary()["personal_data"][0]["file"] == "notes.md"
