"""The fixture of tables of readers."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .harness import Server, kept
from .reader import Reader


@pytest.fixture(scope="session")
def fuzz_server() -> Iterator[Server]:
    """The process that the readers of all tables run below."""
    server = Server()
    yield server
    server.close()


@pytest.fixture
def fuzz(fuzz_server: Server, request: pytest.FixtureRequest) -> Callable[[Reader, int], None]:
    """Return a function that lets a reader read so many bad files, and fails if it fails."""

    def check(reader: Reader, mutations: int) -> None:
        if reader.real:
            request.getfixturevalue("shared_data")
        answer = fuzz_server.ask(Path(request.path).stem, reader.name, mutations)
        if "failed" in answer:
            pytest.fail(answer["failed"])
        if answer["problems"]:
            pytest.fail(kept(reader, answer["problems"]), pytrace=False)

    return check
