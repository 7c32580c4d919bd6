"""LUMPI (Leibniz University multi-perspective intersection): ply and ``Label.csv``.

Source: Busch et al. 2022, and the LUMPI SDK's readme and parser. A measurement has its clouds in
``lidar``, ten a second and numbered from its start, or in a folder there for each sensor. A line
of ``Label.csv`` is time in seconds, object, four of a picture's rectangle, score, class,
points, then centre, length, width, height in metres and heading in radians, in the frame of
the points.
"""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.fidelity.cloud_formats import read_fields
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.readers.documents import (
    finite_numbers,
    laid_out,
    read_json_document,
    read_lines,
)
from urbantwin.fidelity.readers.frame_assembly import frame_of
from urbantwin.fidelity.readers.labels import LabelledBox, boxes_of
from urbantwin.fidelity.readers.plain import clouds_in
from urbantwin.fidelity.readers.recording import Recording

__all__ = ["is_lumpi", "open_lumpi"]

_LABELS = "Label.csv"
_PER_SECOND = 10
#: By number; labels that go up to 7 have vans at 6.
_CLASSES = ("person", "car", "bicycle", "motorcycle", "bus", "truck", "unknown")
_WITH_VANS = (*_CLASSES[:6], "van", "unknown")
_COLUMNS = 16
#: Times are of one measurement, numbers of objects small, places near.
_LARGEST = 2.0**53
_NOTE = "Where the sensors are is not in the clouds: ranges are from the frame's origin."


def _measurement(path: Path) -> Path | None:
    """Return the folder with the labels: the given one, or one or two above it."""
    for folder in (path, path.parent, path.parent.parent):
        if (folder / _LABELS).is_file():
            return folder
    return None


def _folders(path: Path) -> list[Path]:
    """Return the folders that hold clouds of a measurement."""
    if clouds_in(path, ".ply"):
        return [path]
    lidar = path / "lidar"
    if not lidar.is_dir():
        return []
    if clouds_in(lidar, ".ply"):
        return [lidar]
    return sorted(one for one in lidar.iterdir() if one.is_dir() and clouds_in(one, ".ply"))


def is_lumpi(path: Path) -> bool:
    """Return whether a folder is a measurement, its ``lidar``, or a sensor's in that."""
    return path.is_dir() and _measurement(path) is not None and bool(_folders(path))


def open_lumpi(path: Path) -> Recording:
    """Open the clouds of one measurement, of all its sensors together or of one.

    Raises:
        InputError: there are several sensors' folders and none is named, or the labels are wrong.
    """
    folders = _folders(path)
    if len(folders) != 1:
        names = ", ".join(one.name for one in folders)
        raise InputError(
            f"holds {len(folders)} sensors",
            file=path,
            expected=f"one of the folders in it: {names}",
        )
    files = clouds_in(folders[0], ".ply")
    measurement = _measurement(path)
    assert measurement is not None
    labelled = _read_labels(measurement / _LABELS)
    sessions = _sessions(measurement)
    numbered = all(file.stem.isdigit() for file in files)

    def read(index: int) -> Frame:
        file = files[index]
        fields = read_fields(file)
        given: dict[str, NDArray[Any]] = {}
        if "id" in fields:
            given["sensor"] = _sensor_of(fields["id"], sessions)
        number = int(file.stem) if numbered else index
        return frame_of(
            file,
            fields,
            name=file.stem,
            given=given,
            boxes=boxes_of(labelled.get(number, [])),
            notes=(_NOTE,),
        )

    return Recording(path, "lumpi", tuple(file.stem for file in files), read, (_NOTE,))


def _sessions(measurement: Path) -> list[list[int]]:
    """Return the numbers of the sessions of LiDARs, measurement by measurement, if any tells."""
    files = (folder / "meta.json" for folder in (measurement, measurement.parent))
    file = next((one for one in files if one.is_file()), None)
    if file is None:
        return []
    expected = "sessions of LUMPI"
    known: dict[str, list[int]] = defaultdict(list)
    document = read_json_document(file, expected)
    with laid_out(file, expected):
        for number, one in document.get("session", {}).items():
            if one.get("type") == "lidar":
                known[str(one.get("experimentId"))].append(int(number))
    return [sorted(numbers) for numbers in known.values()]


def _sensor_of(identity: NDArray[np.generic], sessions: list[list[int]]) -> NDArray[np.int64]:
    """Return the place of each point's session among those of its measurement.

    Where none is told of, it is that among those in the cloud: they have numbers of any size.
    """
    there, place = np.unique(identity, return_inverse=True)
    told = next((one for one in sessions if np.isin(there, one).all()), None)
    places: NDArray[np.int64] = np.arange(len(there), dtype=np.int64)
    if told is not None:
        places = np.asarray(np.searchsorted(np.array(told), there), np.int64)
    found: NDArray[np.int64] = places[place.ravel()]
    return found


def _read_labels(path: Path) -> dict[int, list[LabelledBox]]:
    """Return the objects by number of the frame that their time falls into."""
    rows = []
    expected = f"{_COLUMNS} numbers of LUMPI"
    with laid_out(path, expected):
        for number, row in enumerate(_rows(path, expected), 1):
            if not row or (number == 1 and not _is_number(row[0])):
                continue  # a line of names
            try:
                values = finite_numbers(value.strip() for value in row[:_COLUMNS])
                if len(values) < _COLUMNS or max(map(abs, values)) > _LARGEST:
                    raise ValueError
            except ValueError:
                raise InputError(
                    "is not a LUMPI label",
                    file=path,
                    place=f"line {number}",
                    expected=expected,
                ) from None
            rows.append(values)
    classes = _WITH_VANS if any(values[7] == len(_CLASSES) for values in rows) else _CLASSES
    found: dict[int, list[LabelledBox]] = defaultdict(list)
    for values in rows:
        kind = int(values[7])
        name = classes[kind] if 0 <= kind < len(classes) else "unknown"
        x, y, z, length, width, height, yaw = values[9:_COLUMNS]
        # A time of 0.3 s times 10 is 3 but for its last bit.
        frame = math.floor(values[0] * _PER_SECOND + 1e-6)
        box = (x, y, z, length, width, height, yaw)
        count = int(values[8])
        found[frame].append(LabelledBox(box, name, int(values[1]), num_points=max(count, -1)))
    return dict(found)


def _rows(path: Path, expected: str) -> Iterator[list[str]]:
    try:
        yield from csv.reader(read_lines(path, expected))
    except csv.Error as error:
        raise InputError(f"is not a table ({error})", file=path, expected=expected) from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
