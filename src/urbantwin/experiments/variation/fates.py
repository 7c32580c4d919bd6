"""State of every object of a dataset: seen, occluded, dropped, out of view, or lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.dataset.motion_interpolation import Rows, rows_at
from urbantwin.dataset.reading import Dataset
from urbantwin.geometry import rotation_from_ypr
from urbantwin.geometry.rays import RayScene
from urbantwin.progress import Progress, each, untold
from urbantwin.taxonomy import semantic_classes
from urbantwin.traffic import Motion
from urbantwin.twin import Twin

__all__ = ["FATES", "fate_changes", "fates_of"]

#: Seen: it has points. Turn lost: no sensor's turn of the frame arrived. Out of view: outside of
#: the region, the range or the field of view. Hidden: it would have points without occlusion.
#: Dropped: no return even without occlusion.
FATES = ("seen", "hidden", "dropped", "out of view", "turn lost")
_OUT = ("outside", "far", "truncated")
#: Rays to an object along each side of its box, within this share of it.
_ALONG, _WITHIN = 3, 0.8
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
        (
            "hiders",
            pa.list_(
                pa.struct([("what", pa.string()), ("track", pa.int32()), ("share", pa.float64())])
            ),
        ),
    ]
)


def fates_of(dataset: Path, motion: Motion, twin: Twin, *, tell: Progress = untold) -> pa.Table:
    """Return a row per frame and object: its state and, if occluded, its occluder.

    The occluder is the first hit of most rays from the sensor to places in the object's box:
    another actor's box, by its track and class, or a part of the scene, by its semantic class
    (``hidden_by``). ``hiders`` lists all occluders of objects that lose points, with their
    fractions of the rays, in descending order.

    Args:
        dataset: the dataset's folder.
        motion: its motion.
        twin: its twin.
        tell: called with the fraction done and a description.

    Raises:
        InputError: a table of the dataset is missing or damaged.
    """
    recorded = Dataset(dataset)
    turns = recorded.turns
    eyes: dict[str, list[NDArray[np.float64]]] = {}
    for name, lost, pose in zip(turns.frame, turns.lost, turns.true, strict=True):
        if not lost:
            eyes.setdefault(name, []).append(pose[:3])
    hiding = _Hiding(twin)
    frames: dict[str, list[dict[str, Any]]] = {}
    for row in recorded.boxes.to_pylist():
        frames.setdefault(row["frame"], []).append(row)
    fates: list[dict[str, Any]] = []
    for frame in each(list(frames), tell, "what became of every object"):
        actors: Rows | None = None
        for row in frames[frame]:
            fate = _fate(row, frame in eyes)
            by, by_track, hiders = None, None, None
            if frame in eyes and row["num_points_alone"] > row["num_points"]:
                if actors is None:
                    actors = rows_at(motion, float(row["time_s"]))
                shares = hiding.shares(row["track"], actors, eyes[frame])
                hiders = [
                    {"what": what, "track": track or None, "share": share}
                    for (what, track), share in shares.items()
                ]
                if fate == "hidden" and hiders:
                    by, by_track = hiders[0]["what"], hiders[0]["track"]
            told = {"fate": fate, "hidden_by": by, "hidden_by_track": by_track, "hiders": hiders}
            fates.append({**{name: row.get(name) for name in _FATE_SCHEMA.names}, **told})
    return pa.Table.from_pylist(fates, schema=_FATE_SCHEMA)


def _fate(row: Mapping[str, Any], arrived: bool) -> str:
    if row["num_points"]:
        return "seen"
    if not arrived:
        return "turn lost"
    if row["ignored"] in _OUT:
        return "out of view"
    return "hidden" if row["num_points_alone"] else "dropped"


def fate_changes(before: pa.Table, after: pa.Table) -> dict[str, int]:
    """Return the number of objects for each change of state: ``seen to hidden``: 3."""
    columns = ("frame", "track", "fate")
    fates = [
        {(row["frame"], row["track"]): row["fate"] for row in table.select(columns).to_pylist()}
        for table in (before, after)
    ]
    changes = Counter(
        f"{fates[0].get(key, 'not there')} to {fates[1].get(key, 'not there')}"
        for key in sorted({*fates[0], *fates[1]})
        if fates[0].get(key) != fates[1].get(key)
    )
    return dict(sorted(changes.items()))


class _Hiding:
    """Finds occluders between sensors and actors.

    Args:
        twin: twin with the scene.
    """

    def __init__(self, twin: Twin) -> None:
        self._scene = RayScene(twin.mesh.vertices, twin.mesh.faces)
        names = {one.id: one.name for one in semantic_classes().values()}
        kinds, self._kind = np.unique(twin.mesh.semantic, return_inverse=True)
        self._names = [names[int(one)] for one in kinds]

    def shares(
        self, track: int, actors: Rows, eyes: Sequence[NDArray[np.float64]]
    ) -> Mapping[tuple[str, int], float]:
        """Return the fraction of rays to a track blocked by each occluder, in descending order.

        Rays lead from every sensor to places in its box. Keys are class and track of an actor, or
        semantic class and 0 for a part of the scene.

        Args:
            track: track of the actor.
            actors: poses of all actors.
            eyes: positions (3,) of the sensors, site frame.
        """
        row = actors[actors["track"] == track]
        if not len(row) or not len(eyes):
            return {}
        targets = _places_in(row[0])
        votes: Counter[tuple[str, int]] = Counter()
        for eye in eyes:
            votes.update(self._first_met(eye, targets, track, actors))
        rays = len(targets) * len(eyes)
        ordered = sorted(votes.items(), key=lambda item: (-item[1], item[0]))
        return {what: count / rays for what, count in ordered}

    def _first_met(
        self, eye: NDArray[np.float64], targets: NDArray[np.float64], track: int, actors: Rows
    ) -> list[tuple[str, int]]:
        """Return the first hit of each blocked ray."""
        way = targets - eye
        reach = np.linalg.norm(way, axis=1)
        ahead = way / reach[:, None]
        origins = np.tile(eye.astype(np.float32), (len(way), 1))
        hit = self._scene.cast_single(origins, ahead.astype(np.float32))
        nearest = np.where(hit.range_m < reach - 0.05, hit.range_m.astype(np.float64), np.inf)
        what: list[tuple[str, int] | None] = [
            (self._names[self._kind[face]], 0) if np.isfinite(far) else None
            for face, far in zip(hit.face, nearest, strict=True)
        ]
        others = actors[actors["track"] != track]
        for other in others[_between(eye, targets, others)]:
            enters = _entered(eye, ahead, other)
            for number in np.flatnonzero(enters < np.minimum(nearest, reach)):
                nearest[number] = enters[number]
                what[number] = str(other["class"]), int(other["track"])
        return [one for one in what if one is not None]


def _between(
    eye: NDArray[np.float64], targets: NDArray[np.float64], actors: Rows
) -> NDArray[np.bool_]:
    """Return which actors (A,) may block rays to places (N, 3), in plan."""
    middle = targets[:, :2].mean(axis=0)
    wide = np.linalg.norm(targets[:, :2] - middle, axis=1).max()
    way = middle - eye[:2]
    far = max(float(np.hypot(*way)), 1e-9)
    at = np.column_stack([actors["x"], actors["y"]]) - eye[:2]
    along = np.clip(at @ way / far, 0.0, far)
    aside = np.linalg.norm(at - along[:, None] * way / far, axis=1)
    reach = np.hypot(actors["length"], actors["width"]) / 2
    return np.asarray(aside <= reach + wide)


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
    """Return the distances (N,) at which rays from a point enter a box; ``inf`` for misses.

    Slab method of Kay and Kajiya (Ray tracing complex scenes, SIGGRAPH 1986).
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
