"""Native code in a child process: whatever it does, the parent gets a result or one line."""

import os
import signal
from pathlib import Path

import pytest

from urbantwin.errors import InputError
from urbantwin.io import child


def called(function, *arguments, size=0):
    return child.read_in_child(function, *arguments, file="a.las", size=size, expected="LAS")


def test_a_result_comes_back_and_the_child_stays():
    assert called("math:hypot", 3.0, 4.0) == 5.0
    pid = called("os:getpid")
    assert pid != os.getpid()
    assert called("os:getpid") == pid


@pytest.mark.parametrize(
    ("function", "arguments", "says"),
    [
        ("os:abort", (), "its reader ended"),
        ("os:_exit", (3,), "its reader ended"),
        ("numpy:ones", (1 << 32,), "more memory"),
        ("math:sqrt", (-1,), "math domain error"),
        ("sys:exit", (), "SystemExit"),
        ("pathlib:Path.nothing", (), "cannot be read as LAS"),
    ],
)
def test_what_goes_wrong_is_one_line_and_the_next_call_works(function, arguments, says):
    with pytest.raises(InputError) as caught:
        called(function, *arguments)
    assert says in str(caught.value)
    assert str(caught.value).startswith("a.las: cannot be read as LAS")
    assert "\n" not in str(caught.value)
    assert called("math:hypot", 3.0, 4.0) == 5.0


def test_what_takes_too_long_is_ended(monkeypatch):
    monkeypatch.setattr(child, "_SECONDS", 0.0)
    with pytest.raises(InputError, match="time than the file's size allows"):
        called("builtins:sum", range(1 << 40))


def test_an_error_of_ours_keeps_its_place(tmp_path):
    path = tmp_path / "a.laz"
    path.write_bytes(b"no LAS at all")
    with pytest.raises(InputError) as caught:
        child.read_in_child("urbantwin.io.las:_count", path, file=path, size=13, expected="LAS")
    assert str(caught.value).startswith(str(path))


def test_the_child_ends_with_its_parent():
    hear, say = os.pipe()
    parent = os.fork()
    if parent == 0:
        os.write(say, str(called("os:getpid")).encode())
        signal.pause()
    pid = int(os.read(hear, 20))
    os.kill(parent, signal.SIGKILL)
    os.waitpid(parent, 0)
    for _ in range(500):
        state = Path(f"/proc/{pid}/stat")
        if not state.exists() or state.read_text(encoding="utf-8").split()[2] == "Z":
            break
        signal.sigtimedwait([], 0.02)
    else:
        os.kill(pid, signal.SIGKILL)
        pytest.fail("the child outlives its parent")
