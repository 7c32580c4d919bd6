"""``trajectories.parquet``: motion of every labelled actor, also before and after the frames.

The input of motion forecasting: past and future at the motion's own steps, including actors that no
beam hits. It extends `AROUND_S` before the first frame and after the last one, more than any
benchmark needs (Argoverse 2: 5 s of past, 6 s of future; Waymo: 1 and 8; nuScenes: 2 and 6).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from urbantwin.dataset.motion_interpolation import SAME_TIME_S
from urbantwin.dataset.reading.columns import ANGLES, PLACE, TRAJECTORIES, arrow_schema
from urbantwin.dataset.track_paths import TrackPaths
from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.lidar.actor_path import PosedActor
from urbantwin.lidar.annotated import annotated_actors, annotated_size

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.traffic.motion import Motion

__all__ = ["AROUND_S", "paths_of_trajectories", "write_trajectories"]

#: Extent before the first frame and after the last, seconds.
AROUND_S = 20.0
#: Part of a motion held in memory, seconds.
_PART_S = 60.0


def write_trajectories(
    path: Path,
    motion: Motion,
    tracks: Collection[int],
    span_s: tuple[float, float],
    *,
    boxes: str = "track",
    seed: int = 0,
    carrier: int | None = None,
) -> None:
    """Write the table, by time, then track; the same motion gives the same bytes.

    A parked vehicle has rows at the first and the last step only.

    Args:
        path: the file.
        motion: the recorded motion.
        tracks: labelled tracks.
        span_s: times of the first and the last frame.
        boxes: size of labels, as ``Rig.boxes``: annotation rules that split a truck move the box's
            centre.
        seed: seed of the drawn sizes.
        carrier: track of the actor that carries the rig, which has no label.
    """
    import pyarrow.parquet as pq

    schema = arrow_schema(TRAJECTORIES)
    middles = _Middles(boxes, seed)
    wanted = np.array(sorted({*tracks} | ({carrier} if carrier is not None else set())), np.int64)
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for rows in _parts(motion, span_s):
            for table in _labelled(rows, wanted, middles, schema):
                writer.write_table(table)


def paths_of_trajectories(table: pa.Table) -> TrackPaths:
    """Return the paths of all tracks of the table, as recorded."""
    times = np.unique(table["time_s"].to_numpy())
    step_s = float(np.diff(times).min()) if len(times) > 1 else 1.0
    return TrackPaths(table, gap_s=1.5 * step_s, beyond_s=step_s + SAME_TIME_S)


def _parts(motion: Motion, span_s: tuple[float, float]) -> Iterator[pa.Table]:
    """Yield the rows of a motion around an interval, in whole steps, with parked vehicles."""
    import pyarrow as pa

    times = motion.times()
    times = times[(times >= span_s[0] - AROUND_S) & (times <= span_s[1] + AROUND_S)]
    if not len(times):
        return
    start = 0
    while start < len(times):
        stop = int(np.searchsorted(times, times[start] + _PART_S))
        rows = motion.rows.between(times[start] - SAME_TIME_S, times[stop - 1] + SAME_TIME_S)
        ends = [times[0]] * (start == 0) + [times[-1]] * (stop == len(times) and len(times) > 1)
        parked_rows = (
            [_standing(motion, time_s) for time_s in ends] if motion.parked.num_rows else []
        )
        all_rows = pa.concat_tables([rows, *parked_rows])
        order = np.lexsort((all_rows["track"].to_numpy(), all_rows["time_s"].to_numpy()))
        yield all_rows.take(pa.array(order))
        start = stop


def _standing(motion: Motion, time_s: float) -> pa.Table:
    import pyarrow as pa

    parked = motion.parked
    when = pa.array(np.full(parked.num_rows, time_s))
    return parked.set_column(parked.column_names.index("time_s"), "time_s", when)


class _Middles:
    """Offsets of box centres from the origins of bodies, by track of the label."""

    def __init__(self, boxes: str, seed: int) -> None:
        self._boxes, self._seed = boxes, seed
        self._known: dict[int, list[tuple[int, str, tuple[float, float, float]]]] = {}

    def of(
        self, track: int, actor_class: str, asset: str, size: tuple[float, float, float]
    ) -> list[tuple[int, str, tuple[float, float, float]]]:
        """Return track, class and centre (x, y, z, body frame) of each label of an actor."""
        if track not in self._known:
            size_or_none = size if min(size) > 0 else None
            actor = PosedActor(
                track, actor_class, asset, 0, Pose(np.eye(3), np.zeros(3)), np.zeros(3), None,
                size_or_none,
            )  # fmt: skip
            labels = []
            for part in annotated_actors(self._boxes, [actor]):
                drawn = part.size
                if self._boxes != "tight":
                    drawn = annotated_size(self._boxes, part, self._seed)
                high = 0.0 if drawn is None else drawn[2] / 2
                labels.append((part.track, part.actor_class, (part.ahead_m, 0.0, high)))
            self._known[track] = labels
        return self._known[track]


def _labelled(
    rows: pa.Table, wanted: NDArray[np.int64], middles: _Middles, schema: pa.Schema
) -> Iterator[pa.Table]:
    """Yield the rows of the wanted labels: one per actor, two for a split truck."""
    import pyarrow as pa

    track = rows["track"].to_numpy()
    _, first, number = np.unique(track, return_index=True, return_inverse=True)
    heads = rows.take(pa.array(first)).to_pylist()
    labels = [
        middles.of(
            int(head["track"]),
            str(head["class"]),
            str(head["asset"]),
            (float(head["length"]), float(head["width"]), float(head["height"])),
        )
        for head in heads
    ]
    turns = rotation_from_ypr(*(rows[name].to_numpy() for name in ANGLES))
    place = np.column_stack([rows[name].to_numpy() for name in PLACE])
    parts = []
    for part in range(max(map(len, labels), default=0)):
        label_of_head = [
            head[part] if part < len(head) else (0, "", (0.0, 0.0, 0.0)) for head in labels
        ]
        label = np.array([head[0] for head in label_of_head], np.int64)[number]
        selected = np.flatnonzero(np.isin(label, wanted))
        offset = np.array([head[2] for head in label_of_head]).reshape(-1, 3)[number]
        middle = place + np.einsum("nij,nj->ni", turns, offset)
        chosen_rows = rows.take(pa.array(selected))
        columns = {name: chosen_rows[name] for name in TRAJECTORIES}
        columns["track"] = pa.array(label[selected], pa.int32())
        columns["class"] = pa.array([label_of_head[k][1] for k in number[selected]], pa.string())
        columns |= {name: pa.array(middle[selected, axis]) for axis, name in enumerate(PLACE)}
        parts.append(pa.table(columns, schema=schema))
    if not parts:
        return
    table = pa.concat_tables(parts)
    order = np.lexsort((table["track"].to_numpy(), table["time_s"].to_numpy()))
    yield table.take(pa.array(order)).combine_chunks()
