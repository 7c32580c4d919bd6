"""Every layout is known by its files, and none is taken for another."""

import re
from pathlib import Path

import pytest

from urbantwin.errors import InputError
from urbantwin.fidelity.readers import LAYOUTS, open_recording
from urbantwin.fidelity.readers.layouts import layout_of

from ..fuzz.small_recordings import RECORDINGS, ROWS

#: Layouts whose recordings are of a sensor alone, without labels.
UNLABELLED = {"ouster", "velodyne", "hesai", "rosbag", "mcap"}


def layout_in(name):
    """The layout of a small recording: what its name begins with."""
    return name.split(",")[0].split(" of ")[0]


def made(name, folder):
    for file, content in RECORDINGS[name].items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_bytes(content)
    return folder


@pytest.mark.parametrize("name", RECORDINGS)
def test_one_layout_knows_a_recording(tmp_path, name):
    folder = made(name, tmp_path / "recording")
    layout = layout_in(name)
    assert layout_of(folder) == layout
    knowing = {one for one, kind in LAYOUTS.items() if kind.detect(folder)}
    assert knowing == {layout}
    assert open_recording(folder).layout == layout
    assert open_recording(tmp_path).layout == layout  # the folder above is enough
    for other in LAYOUTS.keys() - knowing:
        with pytest.raises(InputError, match="is not laid out as"):
            open_recording(folder, other)


@pytest.mark.parametrize(
    ("name", "inside", "given"),
    [
        ("waymo2", "lidar", "s.parquet"),
        ("waymo2", ".", "."),
        ("once", ".", "."),
        ("ips300", "data/PCD_COM_ROI", "."),
        ("tumtraf, first release", ".", "."),
    ],
)
def test_from_within_its_folder(tmp_path, monkeypatch, name, inside, given):
    folder = made(name, tmp_path / "recording")
    monkeypatch.chdir(folder / inside)
    assert open_recording(Path(given)).read(0).boxes is not None


def test_links_to_a_segment(tmp_path):
    """Tables that lie elsewhere under other names, linked as the set has them."""
    for file, content in RECORDINGS["waymo2"].items():
        stored = tmp_path / "store" / file.replace("/", "-")
        stored.parent.mkdir(exist_ok=True)
        stored.write_bytes(content)
        link = tmp_path / "set" / file
        link.parent.mkdir(parents=True)
        link.symlink_to(stored)
    assert open_recording(tmp_path / "set").read(0).boxes is not None
    assert open_recording(tmp_path / "set" / "lidar" / "s.parquet").read(0).boxes is not None


def test_every_layout_has_its_recording_here():
    known = set(map(layout_in, RECORDINGS))
    assert LAYOUTS.keys() - known == {"own", "fleet"}  # of our own commands


@pytest.mark.parametrize("name", RECORDINGS)
def test_frames_of_every_layout_are_whole(tmp_path, name):
    """Points, and what is told of each, are as many; labels of one kind have boxes or classes."""
    frames = list(open_recording(made(name, tmp_path / "recording")))
    assert frames
    for frame in frames:
        assert len(frame.points) > 0
        assert len(frame.sensor_places) >= 1
    labelled = any(f.boxes is not None or f.semantic is not None for f in frames)
    assert labelled == (layout_in(name) not in UNLABELLED)


@pytest.mark.parametrize(
    "files",
    [
        ["lidar/000001.bin"],  # neither LUMPI nor Waymo
        ["lidar_roof/a.pcd", "a.pcd"],  # not ONCE
        ["label/json/000000_LABEL.json", "000000_COM_ROI.pcd"],  # joint clouds without a folder
        ["_points/a.bin", "a.bin"],  # not the first A9
    ],
)
def test_what_only_looks_like_one_of_them(tmp_path, files):
    for file in files:
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(ROWS.tobytes())
    assert layout_of(tmp_path) in (None, "plain")
    assert not any(
        LAYOUTS[name].detect(tmp_path) for name in ("waymo2", "once", "ips300", "tumtraf")
    )


def test_a_table_that_is_no_segment(tmp_path):
    file = tmp_path / "boxes.parquet"
    file.write_bytes(RECORDINGS["waymo2"]["lidar_box/s.parquet"])
    with pytest.raises(InputError, match=r"boxes\.parquet: holds no clouds"):
        open_recording(file)


def test_the_page_says_which_readers_were_checked_on_real_files():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "formats.md").read_text()
    rows = re.findall(r"^\| (`[^|]*) \|.*\| (real files|its description) \|$", page, re.M)
    said = {name: how for names, how in rows for name in re.findall(r"`([a-z0-9-]+)`", names)}
    ways = {True: "real files", False: "its description"}
    assert said == {name: ways[layout.verified] for name, layout in LAYOUTS.items()}


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_says_that_its_reader_was_not_checked_on_real_files(tmp_path, name):
    notes = open_recording(made(name, tmp_path / "recording")).notes
    told = any("not on real files" in note for note in notes)
    assert told is not LAYOUTS[layout_in(name)].verified
