"""What became of every object of a dataset: seen, hidden by whom, dropped, out of view, lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.dataset.motion_interpolation import Rows, rows_at
from urbantwin.dataset.reading import Dataset
from urbantwin.progress import Progress, each, untold
from urbantwin.traffic import Motion
from urbantwin.twin import Twin
from urbantwin.variation.hiding import Hiding

__all__ = ["FATES", "fates_of"]

#: Seen: it has points. Turn lost: no sensor's turn of the frame arrived. Out of view: outside of
#: the region, the range or the field of view. Hidden: it would have points if it were alone.
#: Dropped: even alone it gives no return.
FATES = ("seen", "hidden", "dropped", "out of view", "turn lost")
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
        (
            "hiders",
            pa.list_(
                pa.struct([("what", pa.string()), ("track", pa.int32()), ("share", pa.float64())])
            ),
        ),
    ]
)


def fates_of(dataset: Path, motion: Motion, twin: Twin, *, tell: Progress = untold) -> pa.Table:
    """Return a row for each frame and object: its fate and, if it is hidden, by what.

    What hides it is what most rays from the sensor to places in its box meet first: another actor's
    box, by its track and class, or a part of the scene by its semantic class (``hidden_by``).
    ``hiders`` has all that hides anything of whoever loses a point to another, which share of the
    rays meets each, most first.

    Args:
        dataset: the folder.
        motion: that it shows.
        twin: that it was recorded on.
        tell: called with the fraction done and what is being done.

    Raises:
        InputError: a table of the dataset is missing or damaged.
    """
    recorded = Dataset(dataset)
    turns = recorded.turns
    eyes: dict[str, list[NDArray[np.float64]]] = {}
    for name, lost, pose in zip(turns.frame, turns.lost, turns.true, strict=True):
        if not lost:
            eyes.setdefault(name, []).append(pose[:3])
    hiding = Hiding(twin)
    frames: dict[str, list[dict[str, object]]] = {}
    for row in recorded.boxes.to_pylist():
        frames.setdefault(row["frame"], []).append(row)
    told: list[dict[str, object]] = []
    for frame in each(list(frames), tell, "what became of every object"):
        mine = frames[frame]
        actors: Rows | None = None
        for row in mine:
            fate = _fate(row, frame in eyes)
            by, by_track, hiders = None, None, None
            if frame in eyes and int(str(row["num_points_alone"])) > int(str(row["num_points"])):
                if actors is None:
                    actors = rows_at(motion, float(str(row["time_s"])))
                shares = hiding.shares(int(str(row["track"])), actors, eyes[frame])
                hiders = [
                    {"what": what, "track": its or None, "share": share}
                    for (what, its), share in shares.items()
                ]
                if fate == "hidden" and hiders:
                    by, by_track = hiders[0]["what"], hiders[0]["track"]
            told.append(
                {
                    **{name: row[name] for name in ("frame", "time_s", "track", "class")},
                    "fate": fate,
                    "num_points": row["num_points"],
                    "num_points_alone": row["num_points_alone"],
                    "hidden_by": by,
                    "hidden_by_track": by_track,
                    "hiders": hiders,
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
