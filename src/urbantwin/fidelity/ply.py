"""PLY files (Turk 1994, the Stanford polygon format): ascii, binary of either byte order."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError

__all__ = ["read_ply"]

_TYPES = {
    "char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "uint8": "u1",
    "short": "i2",
    "int16": "i2",
    "ushort": "u2",
    "uint16": "u2",
    "int": "i4",
    "int32": "i4",
    "uint": "u4",
    "uint32": "u4",
    "float": "f4",
    "float32": "f4",
    "double": "f8",
    "float64": "f8",
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class _Element:
    name: str
    count: int
    properties: list[tuple[str, str]] = field(default_factory=list)
    has_list: bool = False


def read_ply(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read the properties of the element ``vertex`` as float64 (N,); the rest is not read.

    Raises:
        InputError: not a PLY file, without vertices, lists before the end of the vertices, or
            less data than the header says.
    """
    data = path.read_bytes()
    order, elements, body = _header(path, data)
    before: list[_Element] = []
    for element in elements:
        if element.has_list and element.name != "vertex":
            before.append(element)
            continue
        if element.name == "vertex":
            break
        before.append(element)
    else:
        raise InputError("has no element vertex", file=path, expected="a PLY cloud")
    if element.has_list or any(other.has_list for other in before):
        raise InputError(
            "has lists before the end of its vertices", file=path, expected="vertices first"
        )
    if order == "":
        return _ascii(path, body, element, sum(other.count for other in before))
    skip = sum(other.count * _record(other, order).itemsize for other in before)
    record = _record(element, order)
    need = skip + element.count * record.itemsize
    if len(body) < need:
        raise InputError(
            f"is truncated: {len(body)} bytes after the header", file=path, expected=f"{need}"
        )
    table = np.frombuffer(body, record, count=element.count, offset=skip)
    with np.errstate(invalid="ignore"):  # of bits that are no number: they become NaN
        return {name: table[name].astype(np.float64) for name, _ in element.properties}


def _header(path: Path, data: bytes) -> tuple[str, list[_Element], bytes]:
    """Return the byte order ("" for ascii), the elements and what comes after the header."""
    order: str | None = None
    elements: list[_Element] = []
    at = 0
    try:
        while True:
            end = data.index(b"\n", at)
            words = data[at:end].decode("ascii", errors="replace").split()
            if at == 0 and words != ["ply"]:
                raise ValueError
            at = end + 1
            match words:
                case ["end_header"]:
                    break
                case ["format", encoding, _]:
                    order = _ORDERS[encoding]
                case ["element", name, count]:
                    if int(count) < 0:
                        raise ValueError
                    elements.append(_Element(name, int(count)))
                case ["property", "list", _, _, _]:
                    elements[-1].has_list = True
                case ["property", kind, name]:
                    if name in (known for known, _ in elements[-1].properties):
                        raise ValueError
                    elements[-1].properties.append((name, _TYPES[kind]))
        if order is None:
            raise ValueError
    except (ValueError, KeyError, IndexError):
        raise InputError("the header is not right", file=path, expected="a PLY file") from None
    return order, elements, data[at:]


def _record(element: _Element, order: str) -> np.dtype[np.void]:
    return np.dtype([(name, order + kind) for name, kind in element.properties])


def _ascii(path: Path, body: bytes, element: _Element, skip: int) -> dict[str, NDArray[np.float64]]:
    lines = body.decode("ascii", errors="replace").splitlines()[skip : skip + element.count]
    if len(lines) < element.count:
        raise InputError(
            f"is truncated: {len(lines)} vertices", file=path, expected=f"{element.count}"
        )
    names = [name for name, _ in element.properties]
    if not lines:
        return {name: np.zeros(0) for name in names}
    try:
        table = np.loadtxt(lines, np.float64, ndmin=2)
    except ValueError as error:
        why = str(error).partition(";")[0]
        raise InputError(
            f"has a line that is not right ({why})", file=path, expected=f"{len(names)} numbers"
        ) from None
    if table.shape != (element.count, len(names)):
        raise InputError(f"has {table.shape[1]} values a line", file=path, expected=f"{len(names)}")
    return {name: table[:, index] for index, name in enumerate(names)}
