"""The harness finds what it is there to find."""

import os
from pathlib import Path

import numpy as np
import pytest

from urbantwin.errors import InputError, StageError

from .harness import Server
from .mutation import mutation
from .reader import Reader


def raises(error: BaseException):
    def read(path: Path) -> None:
        raise error

    return read


def hang(path: Path) -> None:
    while True:
        pass


def _seed() -> list[bytes]:
    return [b'{"lengths": [1.5, 2.5], "name": "a"}']


FAILING = {
    "traceback": (raises(KeyError("lengths")), "KeyError"),
    "exit": (raises(SystemExit(2)), "SystemExit"),
    "long message": (raises(InputError("x " * 2000, expected="y" * 2000)), "InputError"),
    "abort": (lambda path: os.abort(), "ended the process (-6)"),
    "exits": (lambda path: os._exit(0), "ended the process (0)"),
    "memory": (lambda path: np.zeros(3 << 30, np.uint8), "MemoryError"),
    "hang": (hang, "took more than 0.6 s"),
}
SOUND = {
    "input error": raises(InputError("is bad", file="a.json")),
    "stage error": raises(StageError("netconvert failed")),
    "taken": Path.read_bytes,
}
TABLE = Path(__file__).stem
READERS = [
    Reader(name, read, "a.json", _seed, seconds=0.1)
    for name, read in {**{name: read for name, (read, _) in FAILING.items()}, **SOUND}.items()
]


@pytest.mark.parametrize("name", [name for name in FAILING if name != "long message"])
def test_failures_are_found_and_the_next_file_is_read(name: str, fuzz_server: Server) -> None:
    problems = fuzz_server.ask(TABLE, name, 2)["problems"]
    assert list(problems) == ["0", "1"]
    assert all(FAILING[name][1] in problem for problem in problems.values())


@pytest.mark.parametrize("name", SOUND)
def test_errors_on_purpose_are_none(name: str, fuzz_server: Server) -> None:
    assert fuzz_server.ask(TABLE, name, 50)["problems"] == {}


def test_mutations_are_the_same_each_time_and_different_from_each_other() -> None:
    first = [mutation("json", number, _seed()).data for number in range(300)]
    assert first == [mutation("json", number, _seed()).data for number in range(300)]
    assert len(set(first)) > 200
    assert len({mutation("json", number, _seed()).how for number in range(300)}) > 30
