import contextlib
import errno
import fcntl
import os
import pickle
import signal
import subprocess
from pathlib import Path

import pytest

from urbantwin.artefact import (
    Damage,
    check_file,
    check_folder,
    check_room,
    claimed,
    damages,
    kind_of,
    overwriting,
    passing_folder,
    read_json,
    remove_dead,
    replaced_file,
    replaced_folder,
    sha256_of,
    verify,
    write_inventory,
    write_json,
)
from urbantwin.artefact.disk_space import says_no_room
from urbantwin.artefact.written_files import RECORD
from urbantwin.errors import InputError, StageError
from urbantwin.interruption import unwinds

KEY = "0123456789abcdef"


def make(target: Path, number: int = 1, kind: str = "twin") -> None:
    with replaced_folder(target, kind=kind) as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "a").write_text(f"a {number}")
        write_json(folder / f"{kind}.json", {"kind": kind, "number": number})


def names(folder: Path) -> list[str]:
    return sorted(one.name for one in folder.iterdir())


def dead_process() -> int:
    """The number of a process that is over."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def test_a_folder_appears_whole(tmp_path):
    target = tmp_path / "deep" / "twin"
    with replaced_folder(target, kind="twin") as folder:
        write_json(folder / "twin.json", {"kind": "twin"})
        assert not target.exists()
        assert folder.name == f".twin.{os.getpid()}.urbantwin-new"
    assert read_json(target / "twin.json", kind="twin") == {"kind": "twin"}
    assert names(target.parent) == ["twin"]
    assert kind_of(target) == "twin"


def test_an_older_one_is_replaced_whole(tmp_path):
    make(tmp_path / "twin", 1)
    (tmp_path / "link").symlink_to("twin")
    make(tmp_path / "link", 2)
    assert (tmp_path / "twin" / "deep" / "a").read_text() == "a 2"
    assert (tmp_path / "link").is_symlink()
    assert names(tmp_path) == ["link", "twin"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interruption_keeps_the_older_one(tmp_path, error):
    make(tmp_path / "twin", 1)
    with pytest.raises(error), replaced_folder(tmp_path / "twin", kind="twin") as folder:
        write_json(folder / "twin.json", {"number": 2})
        raise error
    assert read_json(tmp_path / "twin" / "twin.json", kind="twin")["number"] == 1
    assert names(tmp_path) == ["twin"]


def test_an_interruption_that_a_library_swallowed_keeps_the_older_one(tmp_path):
    make(tmp_path / "out")
    with unwinds() as interruptions:
        with pytest.raises(KeyboardInterrupt):  # noqa: SIM117 - the first block is the program
            with replaced_folder(tmp_path / "out", kind="twin") as scratch:
                with contextlib.suppress(KeyboardInterrupt):
                    signal.raise_signal(signal.SIGTERM)
                (scratch / "twin.json").write_text('{"kind": "twin", "number": 2}')
        assert interruptions.count == 1
    assert '"number": 1' in (tmp_path / "out" / "twin.json").read_text()
    assert names(tmp_path) == ["out"]


def test_a_failure_takes_the_folders_above_away_again(tmp_path):
    with pytest.raises(ValueError), replaced_folder(tmp_path / "a" / "b" / "twin", kind="twin"):  # noqa: PT011
        raise ValueError
    assert names(tmp_path) == []


def test_what_was_made_waits_for_the_same_key(tmp_path):
    target = tmp_path / "twin"
    with (
        pytest.raises(ValueError, match="now"),
        replaced_folder(target, kind="twin", key=KEY) as folder,
    ):
        (folder / "made").write_text("much work")
        raise ValueError("now")
    assert names(tmp_path) == [f".twin.{os.getpid()}.{KEY}.urbantwin-partial"]
    with (
        pytest.raises(ValueError, match="now"),
        replaced_folder(target, kind="twin", key=KEY[::-1]) as folder,
    ):
        assert names(folder) == []
        raise ValueError("now")
    with replaced_folder(target, kind="twin", key=KEY) as folder:
        assert names(folder) == ["made"]
        write_json(folder / "twin.json", {"kind": "twin"})
    assert names(tmp_path) == ["twin"]


@pytest.mark.parametrize("ending", ["urbantwin-new", f"{KEY}.urbantwin-partial"])
def test_what_dead_runs_left_goes_with_the_next_one(tmp_path, ending):
    left = tmp_path / f".twin.{dead_process()}.{ending}"
    (left / "deep").mkdir(parents=True)
    others = tmp_path / f".motion.{dead_process()}.urbantwin-new"
    others.mkdir()
    make(tmp_path / "twin")
    assert names(tmp_path) == [others.name, "twin"]
    remove_dead(tmp_path)
    assert names(tmp_path) == ["twin"]


def test_what_stepped_aside_comes_back(tmp_path):
    make(tmp_path / "twin", 1)
    (tmp_path / "twin").rename(tmp_path / f".twin.{dead_process()}.urbantwin-old")
    with pytest.raises(KeyboardInterrupt), replaced_folder(tmp_path / "twin", kind="twin"):
        raise KeyboardInterrupt
    assert names(tmp_path) == ["twin"]
    assert damages(tmp_path / "twin") == (2, [])


def test_a_run_keeps_others_out(tmp_path):
    target = tmp_path / "twin"
    with claimed(target) as scratch:
        for check in (
            lambda: check_folder(target, kind="twin"),
            lambda: check_file(target, kind="film"),
            lambda: make(target),
        ):
            with pytest.raises(InputError, match=rf"another run.*process {os.getpid()}\b"):
                check()
        remove_dead(tmp_path)
        assert scratch.folder.is_dir()
        make(tmp_path / "another")
    make(target)


def test_a_lock_of_nobody_known_is_believed(tmp_path):
    # Another machine or container: its processes have numbers that say nothing here.
    left = tmp_path / f".twin.{dead_process()}.urbantwin-new"
    left.mkdir()
    lock = os.open(left, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)
    with pytest.raises(InputError, match="another run"):
        make(tmp_path / "twin")
    os.close(lock)
    make(tmp_path / "twin")
    assert names(tmp_path) == ["twin"]


def test_who_looks_at_the_same_time_is_no_owner(tmp_path):
    left = tmp_path / f".twin.{dead_process()}.urbantwin-new"
    left.mkdir()
    looking = os.open(left, os.O_RDONLY)
    fcntl.flock(looking, fcntl.LOCK_SH)
    check_folder(tmp_path / "twin", kind="twin")
    os.close(looking)


def test_long_names_of_outputs_have_scratch(tmp_path):
    target = tmp_path / ("n" * 255)
    make(target)
    assert names(tmp_path) == [target.name]


@pytest.mark.parametrize(
    ("files", "problem"),
    [
        ({"holiday.jpg": ""}, "holds other files"),
        ({"motion.json": "{}"}, "holds other files"),
        ({"twin.json": "{}"}, "holds other files"),
        ({"twin.json": "not JSON"}, "holds other files"),
        ({"twin.json": '{"kind": "motion"}'}, "holds other files"),
        ({"twin.json": '{"kind": "twin"}', "thesis.tex": ""}, "inventory cannot be used"),
        ({"twin.json": '{"kind": "twin"}', "SHA256SUMS": "?"}, "inventory cannot be used"),
        ({"twin.json": '{"kind": "twin"}', "SHA256SUMS": ""}, r"would be lost \(twin.json\)"),
    ],
)
def test_what_is_not_ours_is_never_replaced(tmp_path, files, problem):
    target = tmp_path / "twin"
    target.mkdir()
    for name, text in files.items():
        (target / name).write_text(text)
    with pytest.raises(InputError, match=problem), replaced_folder(target, kind="twin"):
        pytest.fail("it was let in")
    assert {one.name: one.read_text() for one in target.iterdir()} == files
    assert names(tmp_path) == ["twin"]


@pytest.mark.parametrize("foreign", ["thesis.tex", "deep/thesis.tex", "empty/", ".hidden"])
def test_a_foreign_file_keeps_the_artefact(tmp_path, foreign):
    make(tmp_path / "twin", 1)
    own = tmp_path / "twin" / foreign
    own.mkdir() if foreign.endswith("/") else own.write_text("mine")
    with pytest.raises(InputError, match=f"would be lost .*{foreign}"):
        make(tmp_path / "twin", 2)
    assert own.exists()
    assert (tmp_path / "twin" / "deep" / "a").read_text() == "a 1"


def test_a_foreign_file_that_comes_late_keeps_the_artefact(tmp_path):
    make(tmp_path / "twin", 1)
    with (
        pytest.raises(InputError, match=r"would be lost .*thesis\.tex"),
        replaced_folder(tmp_path / "twin", kind="twin") as folder,
    ):
        write_json(folder / "twin.json", {"kind": "twin"})
        (tmp_path / "twin" / "thesis.tex").write_text("mine")
    assert (tmp_path / "twin" / "thesis.tex").read_text() == "mine"
    assert names(tmp_path) == ["twin"]


def test_a_damaged_older_one_may_be_replaced(tmp_path):
    make(tmp_path / "twin", 1)
    (tmp_path / "twin" / "deep" / "a").unlink()
    make(tmp_path / "twin", 2)
    assert damages(tmp_path / "twin") == (2, [])


@pytest.mark.parametrize(
    ("target", "inputs", "problem"),
    [
        ("twin", ["twin"], "is also an input"),
        ("twin/dataset", [], "is inside a twin"),
        ("twin/deep/dataset", [], "is inside a twin"),
        ("real/dataset", ["real"], "is inside an input"),
        ("way/dataset", ["real"], "is inside an input"),
        (".", ["map.osm"], "holds an input"),
        ("map.osm", ["map.osm"], "is also an input"),
    ],
)
def test_outputs_are_beside_inputs(tmp_path, target, inputs, problem):
    make(tmp_path / "twin")
    (tmp_path / "map.osm").write_text("")
    (tmp_path / "real").mkdir()
    (tmp_path / "way").symlink_to("real")
    given = [None, *(tmp_path / name for name in inputs)]
    with pytest.raises(InputError, match=problem):
        check_folder(tmp_path / target, kind="dataset", inputs=given)
    with pytest.raises(InputError, match=f"{problem}|is a folder"):
        check_file(tmp_path / target, kind="film", inputs=given)


def test_a_file_may_replace_the_input_that_it_improves(tmp_path):
    rig = tmp_path / "rig.yaml"
    rig.write_text("old")
    with pytest.raises(InputError, match="urbantwin did not write it"):
        check_file(rig, kind="align", inputs=[rig], replaces=rig)
    with (
        overwriting(allowed=True),
        replaced_file(rig, kind="align", inputs=[rig], replaces=rig) as path,
    ):
        path.write_text("new")
    assert rig.read_text() == "new"


def test_a_file_takes_its_place_with_its_companions(tmp_path):
    with replaced_file(tmp_path / "scene.obj", kind="obj") as path:
        path.write_text("older")
    with replaced_file(tmp_path / "scene.obj", kind="obj") as path:
        path.write_text("shape")
        path.with_suffix(".mtl").write_text("colours")
        assert (tmp_path / "scene.obj").read_text() == "older"
    (tmp_path / RECORD).unlink()
    assert {one.name: one.read_text() for one in tmp_path.iterdir()} == {
        "scene.obj": "shape",
        "scene.mtl": "colours",
    }
    with (
        overwriting(allowed=True),
        pytest.raises(ValueError),  # noqa: PT011
        replaced_file(tmp_path / "scene.obj", kind="obj") as path,
    ):
        path.write_text("half")
        raise ValueError
    assert (tmp_path / "scene.obj").read_text() == "shape"
    assert names(tmp_path) == ["scene.mtl", "scene.obj"]


def test_a_companion_replaces_nothing_of_somebody(tmp_path):
    (tmp_path / "scene.mtl").write_text("mine")

    def write(companion: str) -> None:
        with replaced_file(tmp_path / "scene.obj", kind="obj") as path:
            path.write_text("mesh")
            path.with_suffix(".mtl").write_text(companion)

    with pytest.raises(InputError, match=r"scene\.mtl: exists, and urbantwin did not"):
        write("materials")
    assert names(tmp_path) == ["scene.mtl"]
    assert (tmp_path / "scene.mtl").read_text() == "mine"
    write("mine")  # as a run leaves it that was killed between the two
    write("materials")  # an older scene has its own
    assert (tmp_path / "scene.mtl").read_text() == "materials"


def test_passing_folders_pass(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / f".urbantwin-fbx-7-0.{dead_process()}.urbantwin-new").mkdir()
    with passing_folder("urbantwin-fbx") as one, passing_folder("urbantwin-fbx") as other:
        assert one != other
        assert len(names(tmp_path)) == 2
    assert names(tmp_path) == []


def sha256sum(folder: Path) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        ["sha256sum", "--check", "--strict", "--quiet", "SHA256SUMS"],
        cwd=folder,
        capture_output=True,
        check=False,
    )


def test_the_inventory_is_what_sha256sum_reads(tmp_path):
    odd = [
        "plain",
        "with space",
        "two\nlines",
        "back\\slash",
        "a\rreturn",
        "ümlaut",
        "-dash",
        "*star",
    ]
    for name in odd:
        (tmp_path / name).write_text(name)
    (tmp_path / os.fsdecode(b"\xff")).write_text("no text")
    (tmp_path / "done").mkdir()
    (tmp_path / "done" / "mark").write_text("")
    write_inventory(tmp_path, known={"plain": sha256_of(tmp_path / "plain")}, without=["done"])
    assert sha256sum(tmp_path).returncode == 0
    assert damages(tmp_path) == (len(odd) + 1, [Damage("done/mark", "foreign")])
    own = (tmp_path / "SHA256SUMS").read_bytes()
    assert sorted(own.splitlines()) == sorted(
        subprocess.run(
            b"sha256sum -- * | grep -av SHA256SUMS", shell=True, cwd=tmp_path, capture_output=True,
            check=True,
        ).stdout.splitlines()
    )  # fmt: skip
    for name in odd:
        (tmp_path / name).write_text("changed")
    assert sha256sum(tmp_path).returncode == 1
    assert {one.name for one in damages(tmp_path)[1]} == {*odd, "done/mark"}


def test_verify_finds_what_is_wrong(tmp_path):
    for name in ("twin", "motion"):
        make(tmp_path / name, kind=name)
    twin = tmp_path / "twin"
    assert [one.damages for one in verify(tmp_path)] == [(), ()]
    (twin / "deep" / "a").write_text("A 1")
    (twin / "thesis.tex").write_text("")
    (tmp_path / "motion" / "motion.json").unlink()
    motion, found = verify(tmp_path)
    assert motion.damages == (Damage("motion.json", "missing"),)
    assert found.damages == (Damage("deep/a", "damaged"), Damage("thesis.tex", "foreign"))
    assert verify(twin / "twin.json") == [found]
    assert [one.damages for one in verify(twin / "deep")] == [(Damage("deep/a", "damaged"),)]
    (twin / "deep" / "a").unlink()
    (twin / "deep" / "a").symlink_to("/etc/hostname")
    assert Damage("deep/a", "missing") in verify(twin)[0].damages
    (twin / "SHA256SUMS").write_text("nonsense")
    with pytest.raises(InputError, match=r"SHA256SUMS: line 1 \(byte 0\): is damaged"):
        verify(twin)
    for path in (tmp_path / "none", tmp_path / "empty"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        with pytest.raises(InputError):
            verify(path)


def test_room_is_asked_for_before_work(tmp_path):
    status = os.statvfs(tmp_path)
    free = status.f_bavail * status.f_frsize
    check_room(tmp_path / "deep" / "new", free / 2, "a dataset")
    with pytest.raises(InputError, match=r"a dataset needs about .*B, and .*B are free"):
        check_room(tmp_path / "deep" / "new", free * 2, "a dataset")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG])
def test_a_full_disk_names_the_file_and_what_to_do(tmp_path, number):
    target, scratch = tmp_path / "twin", tmp_path / "scratch"
    said = f"{target}/deep/a: .*; make room and give the same"
    with pytest.raises(StageError, match=said), says_no_room(target, scratch):
        try:
            raise OSError(number, os.strerror(number), str(scratch / "deep" / "a"))
        except OSError as error:
            raise RuntimeError("a library failed") from error
    with pytest.raises(OSError, match="denied"), says_no_room(target, scratch):
        raise PermissionError(errno.EACCES, "denied")


def test_errors_are_one_line(tmp_path):
    error = InputError("is\nbad", file="a.yaml", place="x.y", expected="better")
    assert str(error) == "a.yaml: x.y: is bad; expected better"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)
    (tmp_path / "a.json").write_text("{")
    for path in (tmp_path / "a.json", tmp_path / "b.json"):
        with pytest.raises(InputError) as caught:
            read_json(path, kind="twin")
        assert "\n" not in str(caught.value)
        assert str(path) in str(caught.value)


def test_the_hash_is_sha256(tmp_path):
    (tmp_path / "abc").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1
    assert sha256_of(tmp_path / "abc") == (
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    )
