"""Reading recorded tracks of any format into the site frame, with checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS, Transformer
from pyproj.exceptions import CRSError, ProjError

from urbantwin.errors import InputError
from urbantwin.geometry import SiteFrame
from urbantwin.site.yaml_document import Document
from urbantwin.taxonomy import ACTOR_CLASSES
from urbantwin.traffic.recorded.csv_rows import csv_rows
from urbantwin.traffic.recorded.description import IGNORED, TracksSpec, class_of, load_description
from urbantwin.traffic.recorded.formats import (
    kitti_rows,
    nuscenes_rows,
    openlabel_rows,
    openscenario_rows,
)
from urbantwin.traffic.recorded.signal_states import states_of
from urbantwin.traffic.recorded.track import (
    RecordedRows,
    RecordedSignals,
    RecordedTrack,
    Recording,
    check_order,
)

__all__ = ["files_of", "read_recording"]

_READERS: dict[str, Callable[[Path, TracksSpec], RecordedRows]] = {
    "csv": csv_rows,
    "openlabel": openlabel_rows,
    "nuscenes": nuscenes_rows,
    "kitti": kitti_rows,
    "openscenario": openscenario_rows,
}
#: Minimum distance of all positions from the site above which the tracks are of another place,
#: metres.
_MAX_DISTANCE_M = 2000.0
_SHORT_M = 1.0


def files_of(path: Path) -> list[Path]:
    """Return the files of a recording.

    Raises:
        InputError: the description is missing or wrong.
    """
    spec, document = load_description(path)
    tracks = path.parent / spec.tracks
    signals = [path.parent / spec.signals.file] if spec.signals else []
    return [*([path] if document else []), tracks, *signals]


def read_recording(path: Path, frame: SiteFrame) -> Recording:
    """Read recorded tracks.

    Args:
        path: a description of tracks (YAML), or a self-contained file of tracks.
        frame: frame of the site.

    Raises:
        InputError: a file is missing or damaged, a class is unknown, times decrease, a track jumps,
            or the tracks are elsewhere. The message names the row.
    """
    spec, document = load_description(path)
    file = path.parent / spec.tracks
    rows = _READERS[spec.format or _format_of(file)](file, spec)
    place, turn, assumed = _site_transform(spec, document, frame, rows)
    xy = place(rows.xyz[:, :2])
    _check_site(rows, xy, assumed)
    yaw = _turned(rows, spec, turn)
    begins_s = float(rows.time_s.min())
    tracks, left_out = [], Counter[str]()
    order = np.argsort(rows.track.astype(str), kind="stable")
    names = rows.track[order].astype(str)
    for rows_of_track in np.split(order, np.flatnonzero(names[1:] != names[:-1]) + 1):
        actor_class = _class(rows, rows_of_track, spec)
        if actor_class == IGNORED:
            left_out[str(rows.kind[rows_of_track[0]])] += 1
            continue
        check_order(rows, rows_of_track, xy[rows_of_track], actor_class)
        size = _median(rows.size[rows_of_track])
        tracks.append(
            RecordedTrack(
                str(rows.track[rows_of_track[0]]),
                actor_class,
                rows.time_s[rows_of_track] - begins_s,
                _middle(xy[rows_of_track], yaw[rows_of_track], size[0], spec),
                yaw[rows_of_track],
                rows.xyz[rows_of_track, 2] + (spec.pose.z if spec.pose else 0.0),
                size,
            )
        )
    if not tracks:
        raise InputError("has no tracks of actors", file=file, expected=", ".join(ACTOR_CLASSES))
    tracks.sort(key=lambda track: (track.time_s[0], len(track.name), track.name))
    ends_s = max(float(track.time_s[-1]) for track in tracks)
    signals = None
    if spec.signals is not None:
        shown = states_of(path.parent / spec.signals.file, spec.signals, begins_s)
        lines = {
            group: tuple(map(tuple, place(np.array(points, np.float64)).tolist()))
            for group, points in spec.signals.places.items()
        }
        signals = RecordedSignals(shown, lines)
    return Recording(file, tuple(tracks), begins_s, ends_s, dict(left_out), signals, assumed)


def _format_of(file: Path) -> str:
    """Return the format of a file, by its name and first bytes.

    Raises:
        InputError: it is unknown.
    """
    suffix = file.suffix.lower()
    name = {".csv": "csv", ".tsv": "csv", ".xosc": "openscenario", ".txt": "kitti"}.get(suffix)
    if name is None and suffix == ".json":
        try:
            with file.open("rb") as opened:
                head = opened.read(4096)
        except OSError:
            raise InputError("not found", file=file, expected="tracks") from None
        name = "openlabel" if b'"openlabel"' in head else "nuscenes"
    if name is None:
        raise InputError(
            "is of an unknown format",
            file=file,
            expected=f"format: {', '.join(_READERS)} in a description of the tracks",
        )
    return name


def _site_transform(
    spec: TracksSpec, document: Document | None, frame: SiteFrame, rows: RecordedRows
) -> tuple[
    Callable[[NDArray[np.float64]], NDArray[np.float64]],
    float,
    tuple[str, ...],
]:
    """Return the transform of the file's x, y to the site, its rotation, and assumptions."""
    if spec.pose is not None:
        turn = np.radians(spec.pose.yaw_deg)
        rotation = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        shift = np.array([spec.pose.x, spec.pose.y])
        return lambda xy: xy @ rotation + shift, float(turn), ()
    if spec.origin is not None:
        source = SiteFrame(spec.origin.latitude, spec.origin.longitude).proj_with_datum
    elif spec.crs is not None:
        source = spec.crs
    elif rows.geographic:
        source = "EPSG:4326"
    else:
        return (
            lambda xy: xy,
            0.0,
            ("x and y are those of the site: no origin, crs or pose is told",),
        )
    try:
        transform = Transformer.from_crs(
            CRS.from_user_input(source), frame.proj_with_datum, always_xy=True
        )
    except (CRSError, ProjError):
        problem = f"is {str(spec.crs)[:60]!r}"
        assert document is not None
        raise document.error(problem, ("crs",), "a CRS that PROJ knows: EPSG:25832") from None

    def place(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.column_stack(transform.transform(xy[:, 0], xy[:, 1]))

    if source == "EPSG:4326":
        return place, 0.0, ()
    middle = np.median(rows.xyz[:, :2], axis=0)
    two = place(np.array([middle, middle + [1.0, 0.0]]))
    east = two[1] - two[0]
    return place, float(np.arctan2(east[1], east[0])), ()


def _check_site(rows: RecordedRows, xy: NDArray[np.float64], assumed: tuple[str, ...]) -> None:
    """Raise an error if the tracks are elsewhere."""
    away = np.linalg.norm(xy, axis=1)
    if not np.isfinite(away).all() or away.min() > _MAX_DISTANCE_M:
        row = int(np.argmin(np.where(np.isfinite(away), away, np.inf)))
        place = ", ".join(f"{value:.9g}" for value in rows.xyz[row, :2])
        far = f", {away[row] / 1000:.0f} km away" if np.isfinite(away[row]) else ""
        reason = assumed[0] if assumed else "the description's origin, crs or pose is another's"
        raise rows.error(
            row,
            f"no track comes near the site: the nearest moment is at {place}{far} ({reason})",
            "the origin (latitude, longitude), crs or pose of the tracks in a description",
        )


def _turned(rows: RecordedRows, spec: TracksSpec, turn: float) -> NDArray[np.float64]:
    """Return headings (N,) in the site frame; nan if unknown."""
    yaw = rows.yaw
    if spec.heading == "north-clockwise":
        yaw = np.pi / 2 - yaw
    return np.asarray(yaw + turn)


def _middle(
    xy: NDArray[np.float64], yaw: NDArray[np.float64], length: float, spec: TracksSpec
) -> NDArray[np.float64]:
    """Return the centres (N, 2) of bounds from the given reference point of the actor."""
    if spec.point == "centre" or np.isnan(length):
        return xy
    facing = np.where(np.isnan(yaw), course(xy), yaw)
    return xy - np.column_stack([np.cos(facing), np.sin(facing)]) * (length / 2)


def course(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction (N,) of a path, rad; zero for a static actor."""
    if len(xy) < 2 or np.ptp(xy, axis=0).max() < _SHORT_M:
        return np.zeros(len(xy))
    moved = np.gradient(xy, axis=0)
    return np.arctan2(moved[:, 1], moved[:, 0])


def _class(rows: RecordedRows, mine: NDArray[np.int64], spec: TracksSpec) -> str:
    """Return the class of a track: that of its most frequent name.

    Raises:
        InputError: it is unknown.
    """
    kinds = Counter(rows.kind[mine].tolist())
    name = max(kinds, key=lambda kind: (kinds[kind], kind))
    actor_class = spec.classes.get(name) or class_of(name)
    if actor_class is None:
        row = int(mine[np.argmax(rows.kind[mine] == name)])
        raise rows.error(
            row,
            f"unknown class {name[:40]!r}",
            f"under classes: of a description, one of {', '.join((*ACTOR_CLASSES, IGNORED))}",
        )
    return actor_class


def _median(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the medians (3,) of sizes; nan if unknown."""
    return np.array(
        [
            np.median(values[is_known]) if (is_known := values > 0).any() else np.nan
            for values in size.T
        ]
    )
