"""OpenPCDet's ``result.pkl``: for each frame a mapping with ``boxes_lidar``, ``score``, ``name``.

Source: OpenPCDet, ``DatasetTemplate.generate_prediction_dicts``: boxes are x, y, z of the centre,
dx, dy, dz, heading in the frame of the points. A pickle may run whatever it likes; here it may make
numbers, texts, lists, mappings and arrays, and nothing else.
"""

from __future__ import annotations

import io
import pickle
import re
from pathlib import Path
from typing import Any, Literal

import numpy as np

from urbantwin.artefact.document import read_bytes
from urbantwin.detections.detections import Detections
from urbantwin.detections.forms.rows import FoundIn, table_of
from urbantwin.errors import InputError

__all__ = ["openpcdet_file", "read_openpcdet"]

_EXPECTED = "a list of mappings with frame_id, name, score and boxes_lidar, numpy arrays in them"
_CODE = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|[SU][0-9]{1,6}|O8?)")


class _Type:
    """What a pickle says of a NumPy type; NumPy's own takes flags that make numbers pointers."""

    def __init__(self, code: object) -> None:
        found = _CODE.fullmatch(code) if isinstance(code, str) else None
        if found is None:
            raise pickle.UnpicklingError(f"wants an array of {code!r:.20}")
        self.code = found[1]
        self.order = "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        if state[1] not in ("<", ">", "|", "="):
            raise pickle.UnpicklingError("wants numbers of an unknown order of bytes")
        self.order = state[1]

    def array(self, content: object, shape: tuple[int, ...], *, columns: bool) -> Any:  # noqa: ANN401
        """Return the array of bytes, or of a list where they are objects."""
        order: Literal["C", "F"] = "F" if columns else "C"
        if self.code.startswith("O"):
            if not isinstance(content, list):
                raise pickle.UnpicklingError("wants objects of bytes")
            objects = np.empty(len(content), object)
            objects[:] = content
            return objects.reshape(shape, order=order)
        if not isinstance(content, bytes | bytearray):
            raise pickle.UnpicklingError("wants numbers of no bytes")
        if self.code.startswith("U"):
            # NumPy takes any number for a letter, and Python then fails wherever the text goes.
            bytes(content).decode("utf-32-be" if self.order == ">" else "utf-32-le")
        kind = np.dtype(("" if self.order == "|" else self.order) + self.code)
        return np.frombuffer(bytes(content), kind).reshape(shape, order=order)


class _Array:
    """An array of a pickle, before and after it is told what it holds."""

    value: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, kind, columns, content = state
        self.value = kind.array(content, shape, columns=bool(columns))


class _Harmless(pickle.Unpickler):
    """Makes nothing but what is here: a pickle's calls of NumPy reach stand-ins, never NumPy."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401 - as the library has it
        # NumPy 2 calls its core another name; the oldest protocols have no bytes of their own.
        wanted = module.replace("numpy._core", "numpy.core").replace("__builtin__", "builtins")
        made = {
            "numpy.ndarray": None,
            "numpy.dtype": self._type,
            "numpy.core.multiarray._reconstruct": self._array,
            "numpy.core.multiarray.scalar": self._scalar,
            "numpy.core.numeric._frombuffer": self._of_buffer,
            "_codecs.encode": self._latin,
            "builtins.bytes": self._no_bytes,
        }
        if f"{wanted}.{name}" not in made:
            raise pickle.UnpicklingError(f"wants {module}.{name}")
        return made[f"{wanted}.{name}"]

    def _type(self, code: object, *_: object) -> _Type:
        return _Type(code)

    def _array(self, *_: object) -> _Array:
        return _Array()

    def _scalar(self, kind: _Type, content: object) -> Any:  # noqa: ANN401
        return kind.array(content, (1,), columns=False)[0]

    def _of_buffer(
        self, content: object, kind: _Type, shape: tuple[int, ...], order: str
    ) -> _Array:
        made = _Array()
        made.value = kind.array(content, shape, columns=order == "F")
        return made

    def _latin(self, text: str, encoding: str) -> bytes:
        if encoding != "latin1":
            raise pickle.UnpicklingError(f"wants bytes of {encoding!r:.20}")
        return text.encode("latin1")

    def _no_bytes(self) -> bytes:
        return b""


def _value(told: object) -> Any:  # noqa: ANN401
    return told.value if isinstance(told, _Array) else told


def openpcdet_file(path: Path) -> Path | None:
    """Return the pickle that a path is or holds; None where there is none."""
    if path.is_file() and path.suffix == ".pkl":
        return path
    file = path / "result.pkl"
    return file if file.is_file() else None


def read_openpcdet(file: Path) -> tuple[Detections, tuple[str, ...]]:
    """Read a pickle of results; see `forms.read_any_form`.

    Raises:
        InputError: it is damaged, wants more than arrays, or is not laid out so.
    """
    content = read_bytes(file, _EXPECTED)
    try:
        told = _Harmless(io.BytesIO(content)).load()
    except Exception as error:
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(f"cannot be read ({reason})", file=file, expected=_EXPECTED) from None
    if not isinstance(told, list):
        raise InputError("is no list", file=file, expected=_EXPECTED)
    found = []
    for number, row in enumerate(told):
        try:
            box = np.asarray(_value(row["boxes_lidar"]), np.float64)
            if len(box) and box.ndim != 2:
                raise ValueError
            box = box[:, :7] if len(box) else np.zeros((0, 7))
            called = [str(name) for name in _value(row["name"])]
            score = np.asarray(_value(row["score"]), np.float64).reshape(-1)
            if box.shape != (len(called), 7) or len(score) != len(called):
                raise ValueError
            found.append(FoundIn(str(row["frame_id"]), box, called, score))
        except (KeyError, TypeError, ValueError, IndexError, OverflowError):
            raise InputError(
                "is not laid out so", file=file, place=f"row {number}", expected=_EXPECTED
            ) from None
    return table_of(found, file)
