"""A reader as the harness knows it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

__all__ = ["SHARED_DATA", "Reader"]

#: The real inputs, beside the checkout (``shared_data`` of tests/conftest.py).
SHARED_DATA = Path(__file__).parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Reader:
    """One reader, and sound files for it.

    Attributes:
        name: of the reader, and of its mutations: another name makes others.
        read: reads the file at a path; raises InputError or StageError, or nothing.
        file: what the file is called that is mutated; may lie in folders (``map/a.json``).
        seeds: returns sound files' contents, small ones. Called once, where mutations are made.
        beside: other files that the reader wants: name -> content, or a function that returns it.
        real: whether the seeds need the real inputs.
        seconds: of the processor's time that one file may take.
    """

    name: str
    read: Callable[[Path], object]
    file: str
    seeds: Callable[[], Sequence[bytes]]
    beside: Mapping[str, bytes] | Callable[[], Mapping[str, bytes]] = field(default_factory=dict)
    real: bool = False
    seconds: float = 10.0

    def __str__(self) -> str:
        return self.name

    def files_beside(self) -> Mapping[str, bytes]:
        return self.beside() if callable(self.beside) else self.beside
