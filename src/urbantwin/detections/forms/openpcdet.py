"""OpenPCDet's ``result.pkl``: for each frame a mapping with ``boxes_lidar``, ``score``, ``name``.

Source: OpenPCDet, ``DatasetTemplate.generate_prediction_dicts``: boxes are x, y, z of the centre,
dx, dy, dz, heading in the frame of the points. A pickle may run whatever it likes; here it may make
numbers, texts, lists, mappings and arrays, and nothing else.
"""

from __future__ import annotations

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact.document import read_bytes
from urbantwin.detections.detections import Detections
from urbantwin.detections.forms.rows import FoundIn, table_of
from urbantwin.errors import InputError

__all__ = ["openpcdet_file", "read_openpcdet"]

_EXPECTED = "a list of mappings with frame_id, name, score and boxes_lidar, numpy arrays in them"
#: All that such a file is made of. NumPy 2 calls its core another name.
_HARMLESS = {("numpy", "ndarray"), ("numpy", "dtype")} | {
    (f"numpy.{core}.{module}", name)
    for core in ("core", "_core")
    for module, name in (
        ("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer"),
    )
}  # fmt: skip


class _Harmless(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401 - as the library has it
        # The oldest protocols have no bytes of their own.
        if (module, name) == ("_codecs", "encode"):
            return _latin
        if name == "bytes" and module in {"builtins", "__builtin__"}:
            return bytes
        if (module, name) not in _HARMLESS:
            raise pickle.UnpicklingError(f"wants {module}.{name}")
        return super().find_class(module.replace("numpy.core", "numpy._core"), name)


def _latin(text: str, encoding: str) -> bytes:
    if encoding != "latin1":
        raise pickle.UnpicklingError(f"wants bytes of {encoding!r:.20}")
    return text.encode("latin1")


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
            box = np.asarray(row["boxes_lidar"], np.float64)
            box = box.reshape(len(box), -1)[:, :7] if len(box) else np.zeros((0, 7))
            called = [str(name) for name in row["name"]]
            score = np.asarray(row["score"], np.float64).reshape(-1)
            if box.shape != (len(called), 7) or len(score) != len(called):
                raise ValueError
            found.append(FoundIn(str(row["frame_id"]), box, called, score))
        except (KeyError, TypeError, ValueError, IndexError):
            raise InputError(
                "is not laid out so", file=file, place=f"row {number}", expected=_EXPECTED
            ) from None
    return table_of(found, file)
