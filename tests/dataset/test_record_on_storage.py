"""Recording onto storage with an address: the same bytes, going on, and what is refused."""

import errno
from collections import Counter

import fsspec
import pyarrow.parquet as pq
import pytest
from fsspec.implementations.memory import MemoryFileSystem

import urbantwin as ut
from urbantwin.artefact.storage import Storage
from urbantwin.dataset import record
from urbantwin.errors import InputError, StageError


class FillingFileSystem(MemoryFileSystem):
    """Memory that is full after so many files."""

    protocol = "filling"
    store: dict = {}  # noqa: RUF012 - fsspec has it so
    pseudo_dirs = [""]  # noqa: RUF012
    files = 0
    written: list = []  # noqa: RUF012

    def pipe_file(self, path, value, mode="overwrite", **options):
        if type(self).files == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        type(self).files -= 1
        self.written.append(path.removesuffix(".part"))
        super().pipe_file(path, value, mode, **options)


@pytest.fixture
def filling():
    fsspec.register_implementation("filling", FillingFileSystem, clobber=True)
    FillingFileSystem.store.clear()
    FillingFileSystem.written.clear()
    FillingFileSystem.files = 10**9
    return FillingFileSystem


def interrupted(*_) -> None:
    raise KeyboardInterrupt


def files_of(place: Storage) -> dict[str, bytes]:
    return place.read_all(place.names())


def test_it_fills_up_and_the_same_call_goes_on_to_the_same_bytes(
    filling, twin, motion, rig, dataset
):
    place = Storage.of("filling://bucket/dataset")
    filling.files = 23
    with pytest.raises(StageError, match="no room left; give the same command again"):
        record(twin, motion, rig, place, workers=1, seed=5)
    assert "SHA256SUMS" not in place.names()
    finished = {name for name in place.names() if name.endswith(".json")}
    assert len(finished) == 4  # of five files each, and one that workers look for
    with pytest.raises(InputError, match="what a run with other options left"):
        record(twin, motion, rig, place, workers=1, seed=6)

    filling.files = 10**9
    filling.written.clear()
    record(twin, motion, rig, place, workers=1, seed=5)
    assert filling.written[-1].endswith("/SHA256SUMS")
    assert sum("/points/" in name for name in filling.written) == 12 - 4
    expected = {
        path.relative_to(dataset).as_posix(): path.read_bytes()
        for path in dataset.rglob("*")
        if path.is_file()
    }
    assert files_of(place) == expected
    with pytest.raises(InputError, match="holds a dataset already"):
        record(twin, motion, rig, place, workers=1, seed=5)


def test_the_frame_with_the_most_labelled_actors_is_here_for_pictures(filling, twin, motion, rig):
    place, seen = Storage.of("filling://bucket/dataset"), []

    def look(folder) -> None:
        seen.extend(path.stem for path in (folder / "points").iterdir())
        boxes = pq.read_table(folder / "boxes.parquet").to_pylist()
        counts = Counter(box["frame"] for box in boxes if box["num_points"] > 0)
        assert counts[seen[0]] == max(counts.values()) > 0

    record(twin, motion, rig, place, workers=1, seed=5, also=look)
    assert len(seen) == 1
    assert place.read(f"points/{seen[0]}.npy")


def test_a_run_that_was_killed_before_the_marks_went_is_finished(filling, twin, motion, rig):
    place = Storage.of("filling://bucket/dataset")
    options = {"workers": 1, "seed": 5, "stop_s": 0.2}
    with pytest.MonkeyPatch.context() as killed, pytest.raises(KeyboardInterrupt):
        killed.setattr(Storage, "remove", interrupted)
        record(twin, motion, rig, place, **options)
    before = files_of(place)
    assert any(name.startswith(".urbantwin-partial/") for name in before)
    filling.written.clear()
    record(twin, motion, rig, place, **options)
    assert not filling.written
    marks = {name for name in before if name.startswith(".urbantwin-partial/")}
    assert files_of(place) == {name: before[name] for name in before.keys() - marks}


def test_one_of_two_runs_to_one_place_is_told_that_the_other_was_first(filling, twin, motion, rig):
    place = Storage.of("filling://bucket/dataset")
    options = {"workers": 1, "seed": 5, "stop_s": 0.4}
    others = []

    def other(share: float, doing: str) -> None:
        if doing.startswith("frame 2") and not others:
            others.append(doing)
            record(twin, motion, rig, place, **options)

    with pytest.raises(StageError, match="another run writes to the same place"):
        record(twin, motion, rig, place, **options, progress=other)
    whole = {name: it for name, it in files_of(place).items() if not name.startswith(".")}
    record(twin, motion, rig, place, **options)  # which removes the marks of the slower one
    assert files_of(place) == whole


def test_the_memory_of_one_process_is_no_place_for_several(twin, motion, rig):
    with pytest.raises(InputError, match=r"memory://a/b.*is not seen from there"):
        record(twin, motion, rig, Storage.of("memory://a/b"), workers=2, seed=5)


def test_a_dataset_for_each_sensor_and_storage_in_columns(filling, twin, motion, rig, tmp_path):
    from dataclasses import replace

    apart = replace(rig, fused=False)
    options = {"workers": 1, "seed": 5, "storage": "zstd", "stop_s": 0.3}
    place = Storage.of("filling://bucket/parts")
    record(twin, motion, apart, place, **options)
    record(twin, motion, apart, tmp_path / "parts", **options)
    assert files_of(place)["SHA256SUMS"] == (tmp_path / "parts" / "SHA256SUMS").read_bytes()
    assert {name.split("/")[0] for name in place.names()} >= {"pole", "dataset.json"}


def test_other_files_are_refused(filling, twin, motion, rig):
    Storage.of("filling://bucket").write("mine.txt", b"")
    with pytest.raises(InputError, match=r"holds other files \(mine.txt\)"):
        record(twin, motion, rig, Storage.of("filling://bucket"), workers=1)


def test_it_is_opened_and_fetched_with_every_file_checked(
    filling, twin, motion, rig, digests, dataset, tmp_path
):
    url = "filling://bucket/dataset"
    place = Storage.of(url)
    with pytest.raises(InputError, match="SHA256SUMS: is not there; expected a whole dataset"):
        ut.open(url)
    for path in dataset.rglob("*"):
        if path.is_file():
            place.write(path.relative_to(dataset).as_posix(), path.read_bytes())
    stored = ut.open(url)
    here = ut.Dataset(dataset)
    assert stored.manifest == here.manifest
    assert stored.summary() == {**here.summary(), "path": url}
    assert stored.fetch(tmp_path / "here", progress=False).names == here.names
    assert digests(tmp_path / "here") == digests(dataset)

    place.write("points/000003.npy", b"other")
    with pytest.raises(InputError, match=r"points/000003.npy: is damaged"):
        stored.fetch(tmp_path / "again", progress=False)
    assert not (tmp_path / "again").exists()
