"""Readers of other formats of detections: KITTI's text, OpenPCDet's pickle, nuScenes' JSON."""

from __future__ import annotations

import io
import pickle
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.document import read_bytes
from urbantwin.detections.checks import checked
from urbantwin.detections.classes import DETECTED_CLASSES, LARGE, detected_class
from urbantwin.detections.detections import Detections, joined
from urbantwin.detections.folder import read_detections
from urbantwin.errors import InputError
from urbantwin.fidelity.readers import Recording
from urbantwin.fidelity.readers.kitti import box_of_values, label_rows, read_calibration
from urbantwin.fidelity.readers.labels import actor_class
from urbantwin.fidelity.readers.nuscenes import box_of_row, names_of_samples
from urbantwin.geometry import Pose
from urbantwin.io.trust import read_json_document

__all__ = ["read_any_form"]


#: x, y, z of the centre, length, width, height, yaw.
Box = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, eq=False)
class FoundIn:
    """The detections of one frame.

    Attributes:
        frame: name of the frame.
        box: (n, 7) in the frame of the points.
        called: (n,) class names of the detector.
        score: (n,) scores.
    """

    frame: str
    box: NDArray[np.float64]
    called: Sequence[str]
    score: NDArray[np.float64]

    @classmethod
    def of_rows(cls, frame: str, rows: Sequence[tuple[Box, str, float]]) -> FoundIn:
        """Build from rows of box, class name and score."""
        return cls(
            frame,
            np.array([box for box, _, _ in rows], np.float64).reshape(-1, 7),
            [called for _, called, _ in rows],
            np.array([score for _, _, score in rows], np.float64),
        )


def _class_of(called: str) -> str | None:
    """Return the detector class of a class name, or another large vehicle's actor class."""
    actor = actor_class(called)
    return detected_class(actor) or (actor if actor in LARGE else None)


def table_of(found: Sequence[FoundIn], file: Path) -> tuple[Detections, tuple[str, ...]]:
    """Return the boxes of known classes, and notes about the others.

    Raises:
        InputError: a number is invalid, no class is known, or a frame occurs twice.
    """
    twice = [name for name, count in Counter(one.frame for one in found).items() if count > 1]
    if twice:
        raise InputError("has a frame twice", file=file, place=f"frame {twice[0]:.60}")
    others: Counter[str] = Counter()
    rows = []
    for one in found:
        names = [_class_of(name) for name in one.called]
        kept = np.array([name is not None for name in names], bool)
        others.update(name for name, keeps in zip(one.called, kept, strict=True) if not keeps)
        rows.append((one.box[kept], [n for n in names if n is not None], one.score[kept]))
    if others and not any(len(names) for _, names, _ in rows):
        raise InputError(
            f"knows only classes like {min(others)!r:.60}",
            file=file,
            expected=", ".join(DETECTED_CLASSES),
        )
    notes = [
        f"{count} boxes of class {name:.60} are left out." for name, count in sorted(others.items())
    ]
    return checked(joined([one.frame for one in found], rows), file), tuple(notes)


_OPENPCDET = "a list of mappings with frame_id, name, score and boxes_lidar, numpy arrays in them"
_CODE = re.compile(r"[<>|=]?(b1|[iu][1248]|f[248]|[SU][0-9]{1,6}|O8?)")


class _Type:
    """A NumPy type of a pickle; NumPy's own type accepts flags that make numbers pointers."""

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
        """Return the array from bytes, or from a list for objects."""
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
            # NumPy accepts any number as a character, on which Python fails later.
            bytes(content).decode("utf-32-be" if self.order == ">" else "utf-32-le")
        kind = np.dtype(("" if self.order == "|" else self.order) + self.code)
        return np.frombuffer(bytes(content), kind).reshape(shape, order=order)


class _Array:
    """An array of a pickle, filled by ``__setstate__``."""

    value: Any = None

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, kind, columns, content = state
        self.value = kind.array(content, shape, columns=bool(columns))


class _Harmless(pickle.Unpickler):
    """Unpickler that maps NumPy's constructors to stand-ins and refuses all others."""

    def find_class(self, module: str, name: str) -> Any:  # noqa: ANN401 - as the library has it
        # NumPy 2 renamed its core; the oldest pickle protocols have no bytes type.
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
    """Return the pickle that a path is or contains; None if there is none."""
    if path.is_file() and path.suffix == ".pkl":
        return path
    file = path / "result.pkl"
    return file if file.is_file() else None


def read_openpcdet(file: Path) -> tuple[Detections, tuple[str, ...]]:
    """Return the detections of a pickle, and notes; see `read_any_form`.

    Raises:
        InputError: the pickle is damaged, needs more than arrays, or has another layout.
    """
    content = read_bytes(file, _OPENPCDET)
    try:
        told = _Harmless(io.BytesIO(content)).load()
    except Exception as error:
        reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(f"cannot be read ({reason})", file=file, expected=_OPENPCDET) from None
    if not isinstance(told, list):
        raise InputError("is no list", file=file, expected=_OPENPCDET)
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
                "is not laid out so", file=file, place=f"row {number}", expected=_OPENPCDET
            ) from None
    return table_of(found, file)


_NUSCENES = "nuScenes' results: translation, size, rotation, detection_name and detection_score"
_NAMES = ("results_nusc.json", "results.json")


def nuscenes_file(path: Path) -> Path | None:
    """Return the results file that a path is or contains; None if there is none."""
    if path.is_file() and path.suffix == ".json":
        return path
    return next((path / name for name in _NAMES if (path / name).is_file()), None)


def read_nuscenes_json(file: Path, recording: Recording) -> tuple[Detections, tuple[str, ...]]:
    """Return the detections of a results file, and notes; see `read_any_form`.

    Samples are those of the recording's tables, or frame names if it has no tables.

    Raises:
        InputError: the file has another layout or unknown frames, or the frames have no poses.
    """
    told = read_json_document(file, _NUSCENES)
    results = told.get("results") if isinstance(told, dict) else None
    if not isinstance(results, dict):
        raise InputError("has no results", file=file, expected=_NUSCENES)
    names = {name: name for name in recording.names}
    if recording.layout == "nuscenes":
        names = names_of_samples(recording.path)
    number = {name: index for index, name in enumerate(recording.names)}
    found = []
    for token, rows in results.items():
        if token not in names or names[token] not in number:
            raise InputError(
                "is of no frame",
                file=file,
                place=f"sample {token:.60}",
                expected=f"samples of {recording.path}",
            )
        if not isinstance(rows, list):
            raise InputError(
                "is no list of boxes",
                file=file,
                place=f"sample {token:.60}",
                expected=_NUSCENES,
            )
        frame = recording.read(number[names[token]])
        if frame.world_SE3_frame is None:
            raise InputError(
                "is in the world, of which these frames say nothing",
                file=file,
                expected=f"{recording.path} with poses",
            )
        found.append(_found_in(names[token], token, rows, frame.world_SE3_frame.inverse(), file))
    return table_of(sorted(found, key=lambda one: number[one.frame]), file)


def _found_in(
    name: str,
    token: str,
    rows: list[dict[str, Any]],
    frame_SE3_world: Pose,
    file: Path,
) -> FoundIn:
    told = []
    for index, row in enumerate(rows):
        try:
            box = box_of_row(row, frame_SE3_world)
            told.append((box, str(row["detection_name"]), float(row["detection_score"])))
        except (KeyError, TypeError, ValueError):
            raise InputError(
                "is not laid out so",
                file=file,
                place=f"sample {token:.60}, box {index}",
                expected=_NUSCENES,
            ) from None
    return FoundIn.of_rows(name, told)


_VALUES = 16
_KITTI = "16 values of KITTI: class, 14 numbers of a label, score"


def _texts(path: Path) -> list[Path]:
    """Return the text files of a folder or of its subfolder ``data`` (KITTI's own layout)."""
    for folder in (path, path / "data"):
        found = sorted(folder.glob("*.txt")) if folder.is_dir() else []
        if found:
            return found
    return []


def is_kitti_text(path: Path) -> bool:
    """Return whether a folder contains text files."""
    return bool(_texts(path))


def read_kitti_text(path: Path, recording: Recording) -> tuple[Detections, tuple[str, ...]]:
    """Return the detections of a folder of text files, and notes; see `read_any_form`.

    A frame without a file was not processed; one with an empty file has no detections.

    Raises:
        InputError: a line is invalid, or the recording has no calibration files.
    """
    calibrations = recording.path / "calib"
    if recording.layout != "kitti" or not calibrations.is_dir():
        raise InputError(
            "is in the frame of KITTI's camera, of which these frames say nothing",
            file=path,
            expected=f"{recording.path} with calib/, as KITTI has it",
        )
    order = {name: number for number, name in enumerate(recording.names)}
    found = []
    for file in _texts(path):
        if file.stem not in order:
            raise InputError("is of no frame", file=file, expected=f"frames of {recording.path}")
        lidar_SE3_camera = read_calibration(calibrations / file.name).camera_SE3_lidar.inverse()
        rows = []
        for number, name, values in label_rows(file, _VALUES):
            if len(values) != _VALUES - 1:
                problem = f"has {len(values) + 1} words"
            elif (values[7:10] <= 0).any() or not 0 <= values[14] <= 1:
                problem = "has a size of 0 m or less, or a score outside of 0 to 1"
            else:
                box = box_of_values(values[7:14], lidar_SE3_camera)
                rows.append((box, name, float(values[14])))
                continue
            raise InputError(problem, file=file, place=f"line {number}", expected=_KITTI)
        found.append(FoundIn.of_rows(file.stem, rows))
    return table_of(sorted(found, key=lambda one: order[one.frame]), path)


def read_any_form(
    path: Path, recording: Callable[[], Recording] | None
) -> tuple[Detections, tuple[str, ...]]:
    """Return detections in any supported format, and notes about them.

    Args:
        path: a folder or a file.
        recording: opens the recording of the detections, needed for formats in other frames:
            KITTI's are in a camera frame, nuScenes' in the world frame.

    Raises:
        InputError: unknown format, a damaged file, or no recording.
    """
    if (path / "detections.json").is_file():
        return read_detections(path), ()
    file = openpcdet_file(path)
    if file is not None:
        return read_openpcdet(file)
    file = nuscenes_file(path)
    if file is not None:
        return read_nuscenes_json(file, _opened(recording, path))
    if is_kitti_text(path):
        return read_kitti_text(path, _opened(recording, path))
    raise InputError(
        "holds no detections" if path.exists() else "is not there",
        file=path,
        expected="detections.json of `urbantwin model detect`, KITTI's texts (16 values a line), "
        "OpenPCDet's result.pkl or nuScenes' results.json",
    )


def _opened(recording: Callable[[], Recording] | None, path: Path) -> Recording:
    if recording is None:
        raise InputError(
            "is not in the frame of the points", file=path, expected="the frames that it is of"
        )
    return recording()
