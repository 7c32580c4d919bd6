"""Every reader of a table, on many bad files: only InputError or StageError, soon, in 2 GB.

A table is a test of this folder with a list ``READERS``; ``conftest.py`` has the fixture:

    READERS = [Reader(...), ...]

    @pytest.mark.parametrize("mutations", NUMBERS)
    @pytest.mark.parametrize("reader", READERS, ids=str)
    def test_bad_files(reader, mutations, fuzz):
        fuzz(reader, mutations)
"""

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from ..thorough import further
from .artefact_set import PLACE
from .mutation import mutation
from .one_child import place
from .reader import Reader

__all__ = ["NUMBERS", "Server", "kept"]

#: How many mutations: each time, and when they are asked for (``make thorough``, ``make fuzz``).
NUMBERS = [1, *further(25), pytest.param(2000, marks=pytest.mark.fuzz)]

ROOT = Path(__file__).parents[2]
#: Where bad files go that a reader did not take as it should.
FAILURES = ROOT / ".fuzz"


class Server:
    """The process that readers run below."""

    def __init__(self) -> None:
        # Children are forked: there must be no threads when they are.
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
        environment = {**os.environ, **dict.fromkeys(names, "1")}
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("server.py")), "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )

    def ask(self, table: str, reader: str, last: int) -> dict[str, Any]:
        """Let a reader read its mutations before ``last``; return what ``run_reader`` does.

        Args:
            table: name of the module that has the reader.
            reader: its name.
            last: how many mutations.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        asked = {"table": table, "reader": reader, "first": 0, "last": last}
        self._process.stdin.write(json.dumps({**asked, "artefacts": os.environ.get(PLACE)}) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        assert answer, f"the server ended with {self._process.wait()}"
        return json.loads(answer)

    def close(self) -> None:
        """Let it end."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()


def kept(reader: Reader, problems: Mapping[str, str]) -> str:
    """Write down the first bad files that a reader failed on; return what went wrong."""
    seeds, beside = list(reader.seeds()), reader.files_beside()
    told = []
    for number, problem in list(problems.items())[:20]:
        bad = mutation(reader.name, int(number), seeds)
        folder = FAILURES / reader.name / number
        place(folder, reader, bad.data, beside)
        told.append(f"{bad}, kept in {folder.relative_to(ROOT)}: {problem}")
    return "\n".join([f"{reader.name}: {len(problems)} failures", *told])
