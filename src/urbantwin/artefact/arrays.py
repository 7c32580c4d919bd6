"""Validated reading of NumPy files: damaged or malicious files give one-line errors.

Declared members and shapes are checked against the file's size before any allocation, pickles are
never read, and exceptions of zipfile, zlib and NumPy become InputError.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError, limit_reached

__all__ = [
    "ArrayOf",
    "array_header",
    "array_of_bytes",
    "checked_arrays",
    "may_unpack",
    "one_line",
    "read_array",
    "read_arrays",
]

Arrays = dict[str, NDArray[Any]]

#: Decompressed size allowed for any file, bytes, and largest ratio to the size of larger files.
_ALWAYS, _TIMES = 256_000_000, 100
#: Characters of a library's message that are quoted.
_SAID = 160


@dataclass(frozen=True)
class ArrayOf:
    """Required form of an array.

    Attributes:
        kind: required dtype, reachable by a lossless cast: ``f8``.
        shape: lengths; a name stands for the same length in all arrays checked together.
        rows_of: name of the length that its values index.
        least, most: bounds of its values.
    """

    kind: str
    shape: tuple[int | str, ...]
    rows_of: str | None = None
    least: float = -math.inf
    most: float = math.inf


def read_arrays(
    path: Path,
    expected: str,
    form: Mapping[str, ArrayOf] | None = None,
    *,
    most: int | None = None,
) -> Arrays:
    """Read the arrays of a ``.npz``.

    Args:
        path: the file.
        expected: expected content, for errors.
        form: required arrays and their forms (see `checked_arrays`); others are not read. If not
            given, all arrays are read.
        most: largest decompressed size, bytes, if smaller than the default.

    Raises:
        InputError: missing, damaged, larger than its size allows, or not of the form.
    """
    arrays: Arrays = {}
    with _one_line(path, expected), zipfile.ZipFile(path) as packed:
        members = packed.infolist()
        size = sum(one.file_size for one in members)
        if most is not None and size > most:
            raise InputError(f"unpacks to more than {most / 1e6:g} MB", file=path)
        if not may_unpack(size, path.stat().st_size):
            raise InputError("unpacks to far more than its size", file=path, expected=expected)
        for member in members:
            name = member.filename.removesuffix(".npy")
            if form is not None and name not in form:
                continue
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise InputError(
                    "is compressed by a method that NumPy does not use",
                    file=path,
                    place=name[:60],
                    expected=expected,
                )
            with _one_line(path, expected, name[:60]):
                with packed.open(member) as stream:
                    size = array_header(stream)[1]
                if size != member.file_size:
                    raise InputError(
                        "does not have the size that its header says", file=path, place=name
                    )
                with packed.open(member) as stream:
                    arrays[name] = np.lib.format.read_array(stream, allow_pickle=False)
    if form is not None:
        checked_arrays(arrays, form, file=path, expected=expected)
    return arrays


def read_array(path: Path, expected: str, form: ArrayOf | None = None) -> NDArray[Any]:
    """Read the array of a ``.npy``.

    Args:
        path: the file.
        expected: expected content, for errors.
        form: required form.

    Raises:
        InputError: missing, damaged, shorter or longer than its header states, or of another form.
    """
    with _one_line(path, expected), path.open("rb") as stream:
        if stream.read(2) == b"PK":
            raise InputError("holds several arrays", file=path, expected=expected)
        stream.seek(0)
        size = array_header(stream)[1]
        have = path.stat().st_size
        if size != have:
            how = "is truncated" if size > have else "goes on behind its array"
            raise InputError(
                f"{how}: {have} bytes of the {size} that its header says",
                file=path,
                expected=expected,
            )
        stream.seek(0)
        array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    if form is not None:
        if not array.dtype.isnative:  # never written by us: a damaged header
            raise InputError(
                f"holds {array.dtype}",
                file=path,
                place="its header",
                expected=str(np.dtype(form.kind)),
            )
        checked_arrays({"": array}, {"": form}, file=path, expected=expected)
    return array


def array_of_bytes(content: bytes, *, file: Path, place: str, expected: str) -> NDArray[Any]:
    """Return the array of a ``.npy`` stored within another file.

    Args:
        content: all of its bytes.
        file: containing file, for errors.
        place: position in that file, for errors.
        expected: expected content, for errors.

    Raises:
        InputError: damaged, or shorter than its header states.
    """
    try:
        stream = io.BytesIO(content)
        _, size, _ = array_header(stream)
        if size > len(content):
            raise ValueError(f"{len(content)} bytes of {size}")
        stream.seek(0)
        array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    except Exception as error:  # the header is parsed as Python, with arbitrary exceptions
        raise InputError(
            f"is damaged ({one_line(error)})", file=file, place=place, expected=expected
        ) from None
    return array


def checked_arrays(
    arrays: Mapping[str, NDArray[Any]],
    form: Mapping[str, ArrayOf],
    *,
    file: Path,
    expected: str,
    within: str = "",
) -> None:
    """Check the forms of arrays that belong together.

    Args:
        arrays: arrays by name.
        form: required form of each; floats must also be finite.
        file: file, for errors.
        expected: expected content, for errors.
        within: prefix of the arrays' names in the file.

    Raises:
        InputError: an array is missing, or has another type, shape or range; names it.
    """
    lengths: dict[str, int] = {}
    for name, wanted in form.items():
        place = f"{within}{name}" or None
        array = arrays.get(name)
        if array is None:
            raise InputError("is missing", file=file, place=place, expected=expected)
        if not np.can_cast(array.dtype, wanted.kind, "safe") or array.dtype.names:
            raise InputError(
                f"holds {array.dtype}", file=file, place=place, expected=str(np.dtype(wanted.kind))
            )
        shape = tuple(
            lengths.setdefault(one, found) if isinstance(one, str) else one
            for one, found in zip(wanted.shape, array.shape, strict=False)
        )
        if len(array.shape) != len(wanted.shape) or array.shape != shape:
            sides = " x ".join(str(lengths.get(str(one), one)) for one in wanted.shape)
            raise InputError(
                f"is of shape {array.shape}", file=file, place=place, expected=sides or "a number"
            )
    for name, wanted in form.items():
        low, high = wanted.least, wanted.most
        if wanted.rows_of is not None:
            low, high = 0, lengths[wanted.rows_of] - 1
        _check_values(arrays[name], low, high, file, f"{within}{name}")


def _check_values(array: NDArray[Any], low: float, high: float, file: Path, name: str) -> None:
    if not array.size:
        return
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        place = _place_of(array, ~np.isfinite(array), name)
        raise InputError("has a value that is not finite", file=file, place=place)
    if low == -math.inf and high == math.inf:
        return
    if array.min() < low or array.max() > high:
        wrong = (array < low) | (array > high)
        raise InputError(
            f"has the value {array[wrong][0]:g}",
            file=file,
            place=_place_of(array, wrong, name),
            expected=f"{low:g} to {high:g}",
        )


def _place_of(array: NDArray[Any], wrong: NDArray[np.bool_], name: str) -> str:
    """Return the index, from 0, of the first value that is wrong."""
    at = np.unravel_index(int(np.argmax(wrong)), array.shape)
    return f"{name or 'value '}[{', '.join(map(str, at))}]"


def may_unpack(size: int, packed: int) -> bool:
    """Return whether a file of ``packed`` bytes may plausibly decompress to ``size`` bytes."""
    return size <= max(_ALWAYS, _TIMES * packed)


def one_line(error: BaseException) -> str:
    """Return the first line of an error's message, or its type."""
    said = " ".join(str(error).split("\n", 1)[0].split())
    return (said if len(said) <= _SAID else said[:_SAID] + "...") or type(error).__name__


def array_header(stream: IO[bytes]) -> tuple[int, int, tuple[int, ...]]:
    """Return header size, total size (bytes) and shape, from the header of a ``.npy``.

    Raises:
        Exception: of any kind: NumPy parses the header as a Python literal.
    """
    version = np.lib.format.read_magic(stream)
    read = (
        np.lib.format.read_array_header_1_0
        if version == (1, 0)
        else np.lib.format.read_array_header_2_0
    )
    shape, _, kind = read(stream)
    count = math.prod(shape)
    if min(shape, default=0) < 0 or (count and not kind.itemsize):
        raise ValueError(f"its shape is {shape}")
    if kind.hasobject:
        raise ValueError("it holds Python's objects")
    return stream.tell(), stream.tell() + count * kind.itemsize, shape


@contextmanager
def _one_line(path: Path, expected: str, place: str | None = None) -> Iterator[None]:
    """Convert all exceptions into one-line errors."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about headers of Python 2, and long integers
            yield
    except InputError:
        raise
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except MemoryError as error:
        limit = limit_reached(error)
        if limit is not None:
            raise limit from error
        raise InputError("needs more memory than there is", file=path, expected=expected) from None
    except Exception as error:  # the header is parsed as Python, with arbitrary exceptions
        problem = f"is not readable ({one_line(error)})"
        raise InputError(problem, file=path, place=place, expected=expected) from None
