"""What the functions return: arrays against the files, one line of text, pictures."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image

import urbantwin as ut
from urbantwin.interface.place import beside

from .conftest import Line


def test_a_frame_is_what_its_files_hold(line: Line) -> None:
    dataset = line.dataset
    assert len(dataset) == 6  # 10 frames a second from 0 to 0.5 s
    assert [frame.name for frame in dataset] == [f"{n:06d}" for n in range(6)]
    np.testing.assert_allclose(dataset.times_s, np.arange(6) / 10)
    frame = dataset[3]
    folder = dataset.folder
    points = np.load(folder / "points" / "000003.npy")
    label = np.fromfile(folder / "semantic" / "000003.label", np.uint32)
    assert frame.points.dtype == np.float32
    np.testing.assert_array_equal(frame.points, points)
    np.testing.assert_array_equal(frame.semantic, label & 0xFFFF)
    np.testing.assert_array_equal(frame.instance, label >> 16)
    np.testing.assert_array_equal(frame.rays, np.load(folder / "rays" / "000003.npy"))
    table = pq.read_table(folder / "boxes.parquet").to_pylist()
    mine = [row for row in table if row["frame"] == "000003"]
    assert frame.boxes.to_pylist() == mine
    assert frame.box_array.shape == (len(mine), 7)
    if mine:
        assert frame.box_array[0, 3] == mine[0]["length"]
    assert set(np.unique(frame.semantic)) <= set(dataset.class_names)


def test_frames_are_asked_for_by_number_name_and_slice(line: Line) -> None:
    dataset = line.dataset
    assert dataset["000002"].time_s == dataset[2].time_s == pytest.approx(0.2)
    assert dataset[-1].name == "000005"
    assert [one.name for one in dataset[1:3]] == ["000001", "000002"]
    with pytest.raises(IndexError):
        dataset[6]
    with pytest.raises(ut.InputError, match="no frame 7"):
        dataset["7"]


def test_points_of_a_frame_lie_in_the_site(line: Line) -> None:
    # The rig's only sensor is 4 m above the ground, 12 m east and 12 m south of the anchor.
    place = line.dataset[0].site_SE3_dataset.translation
    np.testing.assert_allclose(place[:2], [12, -12], atol=1e-6)


def test_sensors_apart_are_datasets_of_their_own(line: Line, tmp_path: Path) -> None:
    apart = ut.record(
        line.twin, line.motion, tmp_path / "apart", stop=0.0, fused=False, workers=1,
        pictures=False, progress=False,
    )  # fmt: skip
    assert list(apart.parts) == ["corner"]
    assert len(apart.parts["corner"]) == 1
    assert len(apart) == 0
    with pytest.raises(ut.InputError, match=r"parts\['corner'\]"):
        apart[0]
    with pytest.raises(ut.InputError, match=r"parts\['corner'\]"):
        apart.where(classes="car")
    with pytest.raises(ut.InputError, match=r"dataset for each sensor.*apart/corner"):
        ut.dataset.sequence(apart, tmp_path / "sequence", progress=False)
    assert ut.Datasets([apart]).sequences == ("corner",)
    assert ut.Datasets([apart])[0].flow().shape == (len(apart.parts["corner"][0].points), 3)
    assert beside(apart.parts["corner"], "report") == tmp_path / "report"


def test_motion_and_twin_have_their_tables(line: Line) -> None:
    table = pq.read_table(line.motion.folder / "actors.parquet")
    assert line.motion.actors.equals(table)
    moving = sum(one == 0.0 for one in table["time_s"].to_pylist())
    assert len(line.motion.at(0.0)) == moving + line.motion.parked.num_rows
    with np.load(line.twin.folder / "scene.npz") as scene:
        np.testing.assert_array_equal(line.twin.mesh.faces, scene["faces"])
    assert {lane.kind for lane in line.twin.lanes} >= {"driving", "sidewalk"}
    assert all(lane.centre.shape[1] == 3 for lane in line.twin.lanes)


@pytest.mark.thorough
def test_a_report_has_the_figures_of_its_file(line: Line, tmp_path: Path) -> None:
    real = ut.record(
        line.twin, line.motion, tmp_path / "real", stop=0.1, seed=5, workers=1,
        pictures=False, progress=False,
    )  # fmt: skip
    told: list[tuple[float, str]] = []
    report = ut.compare(
        real, line.dataset, tmp_path / "report", arbitrary="none", workers=1,
        progress=lambda share, doing: told.append((share, doing)),
    )  # fmt: skip
    assert told[-1][0] == 1.0
    figures = report.figures("hausdorff_p95_m")
    assert figures.shape == (2,)
    assert report.means["hausdorff_p95_m"]["synthetic"] == pytest.approx(figures.mean())
    assert np.isnan(report.figures("hausdorff_p95_m", "arbitrary")).all()
    with pytest.raises(ut.InputError, match="has no far_m"):
        report.figures("far_m")
    assert "Report of 2 pairs" in repr(report)
    drawn = Image.open(report.folder / "report.png")
    shown = Image.open(BytesIO(report.plot()._repr_png_()))
    assert shown.size == drawn.size
    difference = np.asarray(shown.convert("RGB"), int) - np.asarray(drawn.convert("RGB"), int)
    assert np.abs(difference).max() <= 1


@pytest.mark.parametrize("kind", ["twin", "motion", "dataset"])
def test_a_result_says_in_a_line_what_it_is(line: Line, kind: str) -> None:
    made = getattr(line, kind)
    text = repr(made)
    assert "\n" not in text
    assert text.startswith(kind.capitalize())
    assert str(made.folder) in text
    summary = made.summary()
    assert summary["kind"] == kind
    assert str(summary).startswith(f"path: {made.folder}\nkind: {kind}\n")
    assert Path(made) == made.folder


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        ("twin", ()),
        ("motion", ()),
        ("dataset", ()),
        ("dataset", (1, "range_image")),
        ("dataset", ("000002", "histogram")),
    ],
)
def test_a_result_draws_itself(line: Line, tmp_path: Path, kind: str, given: tuple) -> None:
    figure = getattr(line, kind).plot(*given)
    png = figure._repr_png_()  # what a notebook shows
    assert png.startswith(b"\x89PNG")
    colours = Image.open(BytesIO(png)).convert("RGB").getcolors(1 << 24)
    assert colours is not None
    assert len(colours) > 50
    figure.savefig(tmp_path / "a.svg")
    assert (tmp_path / "a.svg").stat().st_size > 10_000


def test_a_picture_that_there_is_not_is_named(line: Line) -> None:
    for draw in (line.twin.plot, lambda picture: line.dataset.plot(0, picture)):
        with pytest.raises(ut.InputError, match="no picture 'portrait'"):
            draw("portrait")
