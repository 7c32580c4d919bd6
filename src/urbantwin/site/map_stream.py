"""Streaming a large map to its reader: progress, time left, and limits on decompression."""

from __future__ import annotations

import bz2
import gzip
import os
import subprocess
import sys
import time
import zlib
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, cast

import osmium.io
from osmium.osm.types import OSMEntity

from urbantwin.errors import InputError, limit_of_process
from urbantwin.progress import Progress, untold
from urbantwin.site.unpack_worker import DAMAGED, TOO_MUCH

__all__ = ["MapStream", "ReadingLimits", "map_size"]

#: Files of which less than this is unpacked are read at once, bytes.
_SMALL = 16 << 20
#: How much of a packed file is unpacked to estimate its size, bytes.
_SAMPLE = 32 << 20
#: A map may unpack to this many times the size estimated from its first bytes.
_FARTHER = 4.0
#: Seconds until the speed of reading is known, and between two looks at the clock.
_SETTLED_S, _LOOK_S = 3.0, 0.25
#: Elements read between two looks at the clock.
_MANY = 256

_WORKER = Path(__file__).with_name("unpack_worker.py")


@dataclass(frozen=True)
class ReadingLimits:
    """What reading a map may take.

    Attributes:
        memory: bytes; ``None`` for half of what is free.
        whole: bytes, of a map that is kept whole: what is done with it takes as much again.
        small: bytes up to which a map is kept whole though only a part of it is asked for.
        seconds: for what is left to read.
        ratio: how many times its size a file may unpack to. Maps are at 10 to 40.
    """

    memory: float | None = None
    whole: float = 3e9
    small: float = 512e6
    seconds: float = 900.0
    ratio: float = 200.0

    def most_memory(self, *, whole: bool) -> float:
        """Return the bytes that a map may take, kept whole or not."""
        most = _free_memory() / 2 if self.memory is None else self.memory
        return min(most, self.whole) if whole else most


def map_size(path: Path) -> float:
    """Return about how many bytes of XML a map is, however it is packed.

    The first bytes of a packed file tell how far it unpacks. A PBF takes about a fifteenth of
    the XML.

    Raises:
        OSError: the file cannot be read.
    """
    size = path.stat().st_size
    name = path.name.lower()
    if name.endswith("pbf"):
        return size * 15.0
    packing = _packing(path)
    if not packing:
        return float(size)
    with path.open("rb", buffering=1 << 16) as file:
        stream = gzip.GzipFile(fileobj=file) if packing == "gz" else bz2.BZ2File(file)
        unpacked = 0
        try:
            while unpacked < _SAMPLE and (chunk := cast(IO[bytes], stream).read(1 << 20)):
                unpacked += len(chunk)
        except (OSError, EOFError, zlib.error):
            return float(max(size, unpacked))  # reported by its reader
        return unpacked * max(1.0, size / file.tell())


class MapStream:
    """A map while it is read: ``with MapStream(...) as stream: for thing in stream.of(reader)``.

    A packed or large file passes through a process of its own, so that its position is known and
    what unpacks to far more than it should is stopped.

    Args:
        path: the map.
        size: see `map_size`.
        limits: what reading may take.
        advice: what to do if it is too much.
        progress: called with the share done (0..1), and the seconds left once they are known.

    Raises:
        InputError: while reading: it unpacks to too much, or takes too long.
    """

    def __init__(
        self,
        path: Path,
        size: float,
        limits: ReadingLimits,
        advice: str,
        progress: Progress | None = None,
    ) -> None:
        self._path, self._size, self._limits, self._advice = path, size, limits, advice
        self._progress = progress or untold
        self._format = "pbf" if path.name.lower().endswith("pbf") else "osm"
        self._packing = _packing(path)
        self._file: int | None = None
        self._pipe: IO[bytes] | None = None
        self._worker: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> MapStream:
        """Start the process that unpacks, where there is one."""
        if self._packing or self._path.stat().st_size > _SMALL:
            self._file = os.open(self._path, os.O_RDONLY)
            most = int(_FARTHER * self._size) + (1 << 28)
            self._worker = subprocess.Popen(
                [
                    *(sys.executable, "-I", str(_WORKER)),
                    *(self._packing, str(most), str(self._limits.ratio)),
                ],
                stdin=self._file,
                stdout=subprocess.PIPE,
            )
            self._pipe = self._worker.stdout
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End the process, whatever happened."""
        if self._worker is None or self._file is None or self._pipe is None:
            return
        self._pipe.close()
        if kind is not None:
            self._worker.terminate()
        code = self._worker.wait()
        os.close(self._file)
        if code == TOO_MUCH:
            raise self._too_much("unpacks to far more than its size suggests") from None
        if code == DAMAGED and kind is None:
            raise RuntimeError("its end is missing or damaged")

    @property
    def bytes(self) -> IO[bytes] | None:
        """What comes out of the process that unpacks; ``None`` where the file itself is read."""
        return self._pipe

    def reader(self) -> osmium.io.Reader:
        """Return osmium's reader of the map."""
        # Absolute: osmium fetches names that look like addresses.
        path = (
            str(self._path.absolute()) if self._pipe is None else f"/dev/fd/{self._pipe.fileno()}"
        )
        return osmium.io.Reader(osmium.io.File(path, self._format))

    def of(self, things: Iterable[OSMEntity]) -> Iterator[OSMEntity]:
        """Yield what is read, and report the progress."""
        if self._file is None:
            yield from things
            return
        packed = self._path.stat().st_size
        began = looked = time.monotonic()
        seen = deque([(began, 0.0)])
        for number, thing in enumerate(things):
            yield thing
            if number % _MANY or (now := time.monotonic()) - looked < _LOOK_S:
                continue
            looked, passed = now, now - began
            share = min(1.0, os.lseek(self._file, 0, os.SEEK_CUR) / packed)
            doing = "reading the map"
            seen.append((now, share))
            while now - seen[0][0] > max(_SETTLED_S, passed / 4):
                seen.popleft()
            recent = (share - seen[0][1]) / (now - seen[0][0]) if len(seen) > 1 else 0.0
            if recent and passed > _SETTLED_S:
                # Ways take longer than nodes: only the recent speed counts.
                left = (1.0 - share) / recent
                if left > self._limits.seconds:
                    raise self._too_much(f"would take {left / 60:.0f} minutes to read")
                doing += f", {_rounded(left)} s left"
            self._progress(share, doing)

    def _too_much(self, why: str) -> InputError:
        size = f"{self._path.stat().st_size / 1e6:.0f} MB"
        return InputError(f"{why} ({size})", file=self._path, expected=self._advice)


def _rounded(seconds: float) -> int:
    """Return seconds, rounded as an estimate deserves."""
    step = 10 if seconds > 30 else 5 if seconds > 10 else 1
    return max(1, step * round(seconds / step))


def _packing(path: Path) -> str:
    """Return how a file is packed; text with the ending of a packed file is read as it is."""
    name = path.name.lower()
    if name.endswith(".bz2"):
        return "bz2"
    if name.endswith(".gz"):
        with path.open("rb") as file:
            return "gz" if file.read(2) == b"\x1f\x8b" else ""
    return ""


def _free_memory() -> float:
    """Return the bytes of memory that are free for this process, if the system reports it."""
    limit = limit_of_process("RLIMIT_AS")
    most = float("inf") if limit is None else float(limit)
    try:
        for line in Path("/proc/meminfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("MemAvailable:"):
                return min(most, float(line.split()[1]) * 1024)
    except (OSError, ValueError):
        pass
    try:
        return min(most, float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    except (OSError, ValueError):
        return min(most, 8e9)
