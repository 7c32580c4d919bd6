"""Streaming of large maps to a reader, with progress, remaining time, and decompression limits."""

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

#: Files with an uncompressed size below this are read directly, bytes.
_SMALL = 16 << 20
#: Uncompressed bytes of a sample that estimates a file's size.
_SAMPLE = 32 << 20
#: Largest ratio of a map's size to the size estimated from its first bytes.
_FARTHER = 4.0
#: Time until the reading speed is known, and between two updates, seconds.
_SETTLED_S, _LOOK_S = 3.0, 0.25
#: Elements read between two checks of the clock.
_MANY = 256

_WORKER = Path(__file__).with_name("unpack_worker.py")


@dataclass(frozen=True)
class ReadingLimits:
    """Limits of reading a map.

    Attributes:
        memory: bytes of memory; ``None`` for half of the free memory.
        whole: bytes of memory for a map read as a whole; its processing takes as much again.
        small: bytes up to which a map is read as a whole even if only a part is requested.
        seconds: longest remaining reading time, seconds.
        ratio: largest decompression ratio of a file; maps have 10 to 40.
    """

    memory: float | None = None
    whole: float = 3e9
    small: float = 512e6
    seconds: float = 900.0
    ratio: float = 200.0

    def most_memory(self, *, whole: bool) -> float:
        """Return the memory limit of a map, read as a whole or not, bytes."""
        most = _free_memory() / 2 if self.memory is None else self.memory
        return min(most, self.whole) if whole else most


def map_size(path: Path) -> float:
    """Return the approximate size of a map as XML, bytes.

    The first bytes of a compressed file give its ratio. A PBF has about a fifteenth of the size of
    XML.

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
    """A map being read: ``with MapStream(...) as stream: for thing in stream.of(reader)``.

    A compressed or large file is read through a separate process, which gives its position and
    stops excessive decompression.

    Args:
        path: the map.
        size: see `map_size`.
        limits: limits of reading.
        advice: advice if a limit is exceeded.
        progress: called with the share done (0..1) and the remaining time, once known.

    Raises:
        InputError: the decompressed size or the time exceeds its limit.
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
        """Start the decompressing process, if needed."""
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
        """End the process."""
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
        """Output of the decompressing process; ``None`` if the file is read directly."""
        return self._pipe

    def reader(self) -> osmium.io.Reader:
        """Return an osmium reader of the map."""
        # Absolute: osmium fetches names that look like addresses.
        path = (
            str(self._path.absolute()) if self._pipe is None else f"/dev/fd/{self._pipe.fileno()}"
        )
        return osmium.io.Reader(osmium.io.File(path, self._format))

    def of(self, things: Iterable[OSMEntity]) -> Iterator[OSMEntity]:
        """Yield elements while reporting progress."""
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
                # Ways take longer than nodes, so only the recent speed is used.
                left = (1.0 - share) / recent
                if left > self._limits.seconds:
                    raise self._too_much(f"would take {left / 60:.0f} minutes to read")
                doing += f", {_rounded(left)} s left"
            self._progress(share, doing)

    def _too_much(self, why: str) -> InputError:
        size = f"{self._path.stat().st_size / 1e6:.0f} MB"
        return InputError(f"{why} ({size})", file=self._path, expected=self._advice)


def _rounded(seconds: float) -> int:
    """Return seconds, rounded to the precision of an estimate."""
    step = 10 if seconds > 30 else 5 if seconds > 10 else 1
    return max(1, step * round(seconds / step))


def _packing(path: Path) -> str:
    """Return a file's compression: ``bz2``, ``gz``, or empty for none."""
    name = path.name.lower()
    if name.endswith(".bz2"):
        return "bz2"
    if name.endswith(".gz"):
        with path.open("rb") as file:
            return "gz" if file.read(2) == b"\x1f\x8b" else ""
    return ""


def _free_memory() -> float:
    """Return the memory available to this process, bytes, if the system reports it."""
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
