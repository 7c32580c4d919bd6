"""What became of every object of a dataset: seen, hidden by whom, dropped, out of view, lost."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.artefact.tables import read_parquet
from urbantwin.dataset.motion_interpolation import Rows, rows_at
from urbantwin.geometry import rotation_from_ypr
from urbantwin.geometry.embree import EmbreeScene
from urbantwin.progress import Progress, each, untold
from urbantwin.taxonomy import semantic_classes
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["FATES", "fates_of"]

#: Seen: it has points. Turn lost: no sensor's turn of the frame arrived. Out of view: outside of
#: the region, the range or the field of view. Hidden: it would have points if it were alone.
#: Dropped: even alone it gives no return.
FATES = ("seen", "hidden", "dropped", "out of view", "turn lost")
#: An object is looked at by so many rays along each side of its box, within this share of it.
_ALONG, _WITHIN = 3, 0.8
_OUT = ("outside", "far", "truncated")
_FATE_SCHEMA = pa.schema(
    [
        ("frame", pa.string()),
        ("time_s", pa.float64()),
        ("track", pa.int32()),
        ("class", pa.string()),
        ("fate", pa.string()),
        ("num_points", pa.int32()),
        ("num_points_alone", pa.int32()),
        ("hidden_by", pa.string()),
        ("hidden_by_track", pa.int32()),
    ]
)


def fates_of(dataset: Path, motion: Motion, twin: Twin, *, tell: Progress = untold) -> pa.Table:
    """Return a row for each frame and object: its fate and, if it is hidden, by what.

    What hides it is what most rays from the sensor to places in its box meet first: another actor's
    box, by its track and class, or a part of the scene by its semantic class.

    Args:
        dataset: the folder.
        motion: that it shows.
        twin: that it was recorded on.
        tell: called with the fraction done and what is being done.

    Raises:
        InputError: a table of the dataset is missing or damaged.
    """
    boxes = read_parquet(dataset / "boxes.parquet", "the boxes of a dataset").to_pylist()
    sweeps = read_parquet(dataset / "sweeps.parquet", "the sweeps of a dataset").to_pylist()
    eyes: dict[str, list[NDArray[np.float64]]] = {}
    for row in sweeps:
        if not row["lost"]:
            at = np.array([row["true_x"], row["true_y"], row["true_z"]])
            eyes.setdefault(row["frame"], []).append(at)
    scene = EmbreeScene(twin.mesh.vertices, twin.mesh.faces)
    names = {one.id: one.name for one in semantic_classes().values()}
    face_names = [names[int(one)] for one in np.unique(twin.mesh.semantic)]
    numbers = np.searchsorted(np.unique(twin.mesh.semantic), twin.mesh.semantic)
    frames: dict[str, list[dict[str, object]]] = {}
    for row in boxes:
        frames.setdefault(row["frame"], []).append(row)
    told: list[dict[str, object]] = []
    for frame in each(list(frames), tell, "what became of every object"):
        mine = frames[frame]
        actors: Rows | None = None
        for row in mine:
            fate = _fate(row, frame in eyes)
            by, by_track = None, None
            if fate == "hidden":
                if actors is None:
                    actors = rows_at(motion, float(str(row["time_s"])))
                by, by_track = _blocker(
                    int(str(row["track"])), actors, eyes[frame], scene, numbers, face_names
                )
            told.append(
                {
                    **{name: row[name] for name in ("frame", "time_s", "track", "class")},
                    "fate": fate,
                    "num_points": row["num_points"],
                    "num_points_alone": row["num_points_alone"],
                    "hidden_by": by,
                    "hidden_by_track": by_track,
                }
            )
    return pa.Table.from_pylist(told, schema=_FATE_SCHEMA)


def _fate(row: dict[str, object], arrived: bool) -> str:
    if row["num_points"]:
        return "seen"
    if not arrived:
        return "turn lost"
    if row["ignored"] in _OUT:
        return "out of view"
    return "hidden" if row["num_points_alone"] else "dropped"


def _blocker(
    track: int,
    actors: Rows,
    eyes: list[NDArray[np.float64]],
    scene: EmbreeScene,
    numbers: NDArray[np.intp],
    face_names: list[str],
) -> tuple[str | None, int | None]:
    """Return what hides a track from the sensors: its class, and its track if it is an actor."""
    row = actors[actors["track"] == track]
    if not len(row):
        return None, None
    targets = _places_in(row[0])
    votes: Counter[tuple[str, int]] = Counter()
    for eye in eyes:
        way = targets - eye
        reach = np.linalg.norm(way, axis=1)
        ahead = way / reach[:, None]
        origins = np.tile(eye.astype(np.float32), (len(way), 1))
        hit = scene.cast_single(origins, ahead.astype(np.float32))
        nearest = np.where(hit.range_m < reach - 0.05, hit.range_m.astype(np.float64), np.inf)
        what: list[tuple[str, int] | None] = [
            (face_names[numbers[face]], 0) if np.isfinite(far) else None
            for face, far in zip(hit.face, nearest, strict=True)
        ]
        for other in actors:
            if int(other["track"]) == track:
                continue
            enters = _entered(eye, ahead, other)
            for number in np.flatnonzero(enters < np.minimum(nearest, reach)):
                nearest[number] = enters[number]
                what[number] = str(other["class"]), int(other["track"])
        votes.update(one for one in what if one is not None)
    if not votes:
        return None, None
    (name, by), _ = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return name, by or None


def _places_in(row: np.void) -> NDArray[np.float64]:
    """Return places (N, 3) spread over a box, site frame."""
    share = np.linspace(-_WITHIN / 2, _WITHIN / 2, _ALONG)
    x, y, z = (grid.ravel() for grid in np.meshgrid(share, share, share))
    local = np.column_stack([x * row["length"], y * row["width"], (z + 0.5) * row["height"]])
    turn = rotation_from_ypr(row["yaw"], row["pitch"], row["roll"])
    return np.asarray(local @ turn.T + [row["x"], row["y"], row["z"]])


def _entered(
    eye: NDArray[np.float64], ahead: NDArray[np.float64], row: np.void
) -> NDArray[np.float64]:
    """Return the distance (N,) at which rays from a place enter a box; ``inf`` where they do not.

    The slabs of Kay and Kajiya (Ray tracing complex scenes, SIGGRAPH 1986).
    """
    turn = rotation_from_ypr(row["yaw"], row["pitch"], row["roll"])
    start = (eye - [row["x"], row["y"], row["z"]]) @ turn
    way = ahead @ turn
    half = np.array([row["length"] / 2, row["width"] / 2])
    low = np.array([-half[0], -half[1], 0.0])
    high = np.array([half[0], half[1], row["height"]])
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - start) / way, (high - start) / way
    enters = np.fmin(first, second).max(axis=1)
    leaves = np.fmax(first, second).min(axis=1)
    return np.where((enters <= leaves) & (leaves > 0), np.maximum(enters, 0.0), np.inf)
