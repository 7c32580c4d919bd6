"""Opening whatever is on disk."""

from pathlib import Path

import numpy as np
import pytest

import urbantwin as ut
from urbantwin.artefact import KINDS, write_json
from urbantwin.interface.site_file import Site
from urbantwin.interface.whole_line import Run

from .conftest import Line


def test_what_a_command_wrote_is_opened_as_what_it_is(line: Line) -> None:
    for made in (line.twin, line.motion, line.dataset):
        opened = ut.open(made)
        assert type(opened) is type(made)
        assert repr(opened) == repr(made)
        kind = type(made).__name__.lower()
        assert type(ut.open(made.folder / f"{kind}.json")) is type(made)
    run = ut.open(line.twin.folder.parent)
    assert isinstance(run, Run)
    assert len(run.dataset) == len(line.dataset)


def test_inputs_are_opened_too(line: Line, tmp_path: Path) -> None:
    site = ut.open(line.site)
    assert isinstance(site, Site)
    assert site.checked.name == "two-avenues"
    assert [one.name for one in ut.open(line.twin.rig_path).sensors] == ["corner"]
    cloud = ut.open(line.dataset.folder / "points" / "000000.npy")
    np.testing.assert_array_equal(cloud.points, line.dataset[0].points[:, :3])
    (tmp_path / "real").mkdir()
    np.save(tmp_path / "real" / "0.npy", line.dataset[0].points)
    frames = ut.open(tmp_path / "real")
    assert len(frames) == 1
    np.testing.assert_array_equal(frames.read(0).points, line.dataset[0].points[:, :3])


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_artefact_is_known(tmp_path: Path, kind: str) -> None:
    write_json(tmp_path / f"{kind}.json", {"kind": kind})
    if kind in (
        "twin", "motion", "dataset", "report", "sequence", "fleet", "placement", "campaign",
    ):  # fmt: skip
        with pytest.raises(ut.InputError, match=f"{kind}.json: .*(lacks|is missing|is of version)"):
            ut.open(tmp_path)
    else:
        assert ut.open(tmp_path).folder == tmp_path


def test_coverage_and_background_are_read_as_they_were_written(line: Line, tmp_path: Path) -> None:
    made = ut.rig.coverage(
        line.twin, tmp_path / "coverage", cell=2.0, pictures=False, progress=False
    )
    opened = ut.open(tmp_path / "coverage")
    with np.load(tmp_path / "coverage" / "coverage.npz") as maps:
        for layer in ("ground", "lying", "facing"):
            np.testing.assert_array_equal(getattr(opened.densities, layer), maps[layer])
    assert opened.summary() == made.summary()
    assert opened.plot()._repr_png_().startswith(b"\x89PNG")
    assert made.plot()._repr_png_().startswith(b"\x89PNG")

    second = {"stop": 1.0, "workers": 1, "pictures": False, "progress": False}
    frames = ut.record(line.twin, line.motion, tmp_path / "frames", **second)
    measured = ut.rig.background(frames, tmp_path / "a.npz", twin=line.twin, progress=False)
    images = ut.open(tmp_path / "a.npz").sensors
    assert len(images) == len(measured.sensors) == 1
    np.testing.assert_array_equal(images[0].range_m, measured.sensors[0].range_m)
    # Most beams of a sensor that stood still found the static world.
    assert "corner" in repr(measured)
    assert images[0].known.mean() > 0.3


@pytest.mark.parametrize("name", ["missing", "notes.txt"])
def test_what_is_none_of_ours_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(ut.InputError, match=name):
        ut.open(tmp_path / name)


def test_one_sensor_and_all() -> None:
    catalogue = ut.catalogue.sensors()
    assert len(catalogue) == len(catalogue.names) > 20
    sheet = catalogue["VLP-16"]
    # Velodyne VLP-16 user manual, table 9-1.
    assert sorted(sheet.sensor.elevation_deg) == pytest.approx(list(range(-15, 16, 2)), abs=0.05)
    assert repr(sheet) == repr(ut.catalogue.sensors("VLP-16"))
    assert repr(catalogue).count("\n") == len(catalogue)
    with pytest.raises(KeyError):
        catalogue["nothing"]


def test_what_was_changed_is_found(line: Line, tmp_path: Path) -> None:
    exported = ut.export(line.twin, "geojson", tmp_path / "layers", progress=False)
    assert ut.dataset.verify(exported, progress=False)
    first = next(path for path in ut.open(exported).files if path.suffix == ".geojson")
    first.write_bytes(first.read_bytes() + b" ")
    found = ut.dataset.verify(exported, progress=False)
    assert not found
    assert [one.name for one in found.damages] == [first.name]
    with pytest.raises(ut.InputError, match=first.name):
        found.check()
