"""Files of one frame in any storage: the reader of what ``layout.write_frame`` writes."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import ArrayOf, array_header, read_array
from urbantwin.dataset.frame_columns import read_columns
from urbantwin.dataset.frame_las import read_laz
from urbantwin.dataset.reading.columns import POINT
from urbantwin.errors import InputError

__all__ = ["FOLDERS", "RAY_TYPE", "STORED", "FrameFiles", "ray_place", "read_labels", "read_rays"]
__all__ += ["stored_frames"]

#: Folders of a dataset with files of its frames.
FOLDERS = ("points", "labels", "semantic", "rays")
#: One ray: index of the sensor in the rig, channel, firing within the turn, firing time (seconds
#: relative to the frame's, by the sensor's clock), and number of the return within its beam (0, the
#: first reported, or 1).
RAY_TYPE = np.dtype(
    [("sensor", "u1"), ("ring", "<u2"), ("column", "<u2"), ("time", "<f4"), ("echo", "u1")]
)
#: Storage formats of points, and the suffix of their files in ``points/``.
STORED = {"npy": ".npy", "zstd": ".parquet", "laz": ".laz"}

_POINTS, _RAYS = "the points of a frame", "a table of rays, one for each point"
#: Limit of channels; no sensor has as many.
_MOST_RINGS = 4096


class FrameFiles:
    """Arrays of one frame, read at first use.

    Args:
        dataset: folder of the dataset.
        name: name of the frame.
        storage: format of the dataset, one of `STORED`; detected if not given.

    Attributes:
        file: file of its points; in column formats, of all arrays.
    """

    def __init__(self, dataset: Path, name: str, storage: str | None = None) -> None:
        self.dataset, self.name = dataset, name
        endings = STORED.values() if storage is None else [STORED.get(storage, STORED["npy"])]
        files = [dataset / "points" / f"{name}{ending}" for ending in endings]
        self.file = next((file for file in files if file.is_file()), files[0])

    def __str__(self) -> str:
        """Return the file of the points, relative to the dataset."""
        return f"points/{self.file.name}"

    def problem_of_sizes(self) -> str | None:
        """Return a problem with the sizes of plain files, without reading their contents."""
        rows: int | None = None
        for folder in ("points", "rays"):
            file = self.dataset / folder / f"{self.name}.npy"
            if not file.is_file():
                continue
            try:
                with file.open("rb") as stream:
                    _, whole, shape = array_header(stream)
            except Exception:  # the header is Python syntax: its parser raises anything
                return f"{folder}/{file.name}: is no array"
            size = file.stat().st_size
            if size != whole:
                return f"{folder}/{file.name}: has {size:,} bytes; expected {whole:,}"
            if rows is not None and shape and shape[0] != rows:
                return f"{folder}/{file.name}: has {shape[0]:,} rows for {rows:,} points"
            rows = shape[0] if shape else 0
        labels = self.dataset / "semantic" / f"{self.name}.label"
        if rows is not None and labels.is_file() and labels.stat().st_size != 4 * rows:
            size = labels.stat().st_size
            return f"semantic/{labels.name}: has {size:,} bytes; expected 4 for each of {rows:,}"
        return None

    @cached_property
    def points(self) -> NDArray[np.float32]:
        """Points (N, 4): x, y, z in metres, dataset frame, and intensity 0..1.

        Raises:
            InputError: missing or damaged.
        """
        if self.is_plain:
            return read_array(self.file, _POINTS, ArrayOf("f4", ("N", 4)))
        columns = self._columns(POINT)
        points = np.empty((len(columns["x"]), 4), np.float32)
        for k, name in enumerate(POINT):
            points[:, k] = columns[name]
        if not np.isfinite(points).all():
            raise InputError("has a value that is not finite", file=self.file)
        return points

    @cached_property
    def labels(self) -> NDArray[np.uint32]:
        """Labels (N,) of the points: class in the low 16 bits, track in the high.

        Raises:
            InputError: missing, or of another length.
        """
        if self.is_plain:
            return read_labels(self.labels_file, len(self.points))
        columns = self._columns(("semantic", "instance"))
        labels: NDArray[np.uint32] = columns["instance"].astype("<u4")
        labels <<= 16
        labels |= columns["semantic"]
        return labels

    @cached_property
    def rays(self) -> NDArray[np.void]:
        """Ray (N,) of each point; datasets of older versions lack some fields.

        Raises:
            InputError: missing, or invalid: integers, and finite times.
        """
        if self.is_plain:
            return read_rays(self.rays_file, len(self.points))
        columns = self._columns(RAY_TYPE.names or ())
        rays = np.empty(len(columns["ring"]), RAY_TYPE)
        for name, values in columns.items():
            rays[name] = values
        if not np.isfinite(rays["time"]).all():
            raise InputError("has a time that is not finite", file=self.file, place="time")
        return rays

    @property
    def known_rays(self) -> NDArray[np.void] | None:
        """`rays` if the file exists; the length is not compared with the points.

        Raises:
            InputError: the file is damaged.
        """
        if not self.rays_file.is_file():
            return None
        return read_rays(self.rays_file) if self.is_plain else self.rays

    @property
    def known_labels(self) -> NDArray[np.uint32] | None:
        """`labels` if the file exists; the length is not compared with the points.

        Raises:
            InputError: the file is damaged.
        """
        if not self.labels_file.is_file():
            return None
        return read_labels(self.labels_file) if self.is_plain else self.labels

    @property
    def labels_file(self) -> Path:
        """File of the labels."""
        plain = self.dataset / "semantic" / f"{self.name}.label"
        return plain if self.is_plain else self.file

    @property
    def rays_file(self) -> Path:
        """File of the rays."""
        plain = self.dataset / "rays" / f"{self.name}.npy"
        return plain if self.is_plain else self.file

    @property
    def is_plain(self) -> bool:
        """Whether points, labels and rays are separate files."""
        return self.file.suffix == STORED["npy"]

    @property
    def fields(self) -> dict[str, NDArray[Any]]:
        """The points as fields by name: x, y, z and intensity."""
        return {name: self.points[:, k] for k, name in enumerate(POINT)}

    def _columns(self, names: tuple[str, ...]) -> dict[str, NDArray[Any]]:
        if self.file.suffix == STORED["zstd"]:
            return read_columns(self.file, names, _POINTS)
        return {name: self._laz[name] for name in names}

    @cached_property
    def _laz(self) -> dict[str, NDArray[Any]]:
        return read_laz(self.file)


def stored_frames(dataset: Path) -> list[str]:
    """Return the names of the frames with points in a column format, unordered."""
    endings = (STORED["zstd"], STORED["laz"])
    try:
        inside = list((dataset / "points").iterdir())
    except OSError:
        return []
    return [
        file.stem for file in inside if file.suffix in endings and not file.name.startswith(".")
    ]


def read_labels(path: Path, points: int | None = None) -> NDArray[np.uint32]:
    """Return the labels (N,) of a frame's points: class in the low 16 bits, track in the high.

    Args:
        path: the ``.label`` file.
        points: number of points; not checked if not given.

    Raises:
        InputError: missing, or of another length.
    """
    expected = "4 bytes for each point" if points is None else f"{4 * points} bytes"
    expected += ", a label for each point" if points is not None else ", its label"
    try:
        size = path.stat().st_size
        whole = size - size % 4 if points is None else 4 * points
        if size != whole:
            place = f"byte {min(size, whole)}"
            raise InputError(f"has {size} bytes", file=path, place=place, expected=expected)
        return np.fromfile(path, "<u4")
    except FileNotFoundError:
        raise InputError("not found", file=path, expected=expected) from None
    except OSError as error:
        why = error.strerror or "unknown"
        raise InputError(f"cannot be read ({why})", file=path, expected=expected) from None


def read_rays(path: Path, points: int | None = None) -> NDArray[np.void]:
    """Return the rays of a frame's points; datasets of older versions lack some fields.

    Args:
        path: the ``.npy`` file.
        points: number of points; not checked if not given.

    Raises:
        InputError: missing, or invalid: integers, and finite times.
    """
    table: NDArray[np.void] = read_array(path, _RAYS)
    if not table.dtype.names or table.ndim != 1 or (points is not None and len(table) != points):
        raise InputError(f"is an array of shape {table.shape}", file=path, expected=_RAYS)
    for name in table.dtype.names:
        kind = table.dtype[name]
        if kind.shape or kind.kind not in ("f" if name == "time" else "ui"):
            raise InputError(f"holds {kind}", file=path, place=name[:40], expected=_RAYS)
        if kind.kind == "f" and not np.isfinite(table[name]).all():
            place = ray_place(path, table, name, int(np.argmin(np.isfinite(table[name]))))
            raise InputError("has a time that is not finite", file=path, place=place)
    if "ring" in table.dtype.names and len(table) and table["ring"].max() >= _MOST_RINGS:
        row = int(np.argmax(table["ring"] >= _MOST_RINGS))
        raise InputError(
            f"has ring {table['ring'][row]}",
            file=path,
            place=ray_place(path, table, "ring", row),
            expected=f"0 to {_MOST_RINGS - 1}",
        )
    return table


def ray_place(path: Path, table: NDArray[np.void], name: str, row: int) -> str:
    """Describe a value in a frame's table of rays: field, row and byte offset."""
    fields = table.dtype.fields
    assert fields is not None
    begin = path.stat().st_size - table.nbytes
    return f"{name} of ray {row} (byte {begin + row * table.itemsize + fields[name][1]})"
