"""Insertion: actors added to a motion, in which everybody else stays exactly as they were."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pyarrow as pa

from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface, prescribed_table

__all__ = ["inserted"]


def inserted(
    motion: Motion, paths: Sequence[PrescribedPath], surface: TwinSurface
) -> tuple[Motion, tuple[int, ...]]:
    """Return a motion with further actors, and the numbers of their tracks.

    The rows of everybody else are those of ``motion``, to the byte, and so are the signals and the
    meshes. Nobody reacts to those who are added. Their tracks follow the highest number in
    ``motion`` in the order of ``paths``; ``motion.json`` names them under ``inserted``.

    Args:
        motion: the motion.
        paths: who is added; moments before and after the motion are of no account.
        surface: of the twin that the motion is on.

    Example:
        >>> path = PrescribedPath("car", "car-sedan_black", np.array([0.0, 9.0]),
        ...                       np.array([[-40.0, -2.0], [40.0, -2.0]]))
        >>> changed, (track,) = inserted(motion, [path], TwinSurface(twin))
    """
    taken = motion.actors["track"].to_numpy()
    before = [row["track"] for row in motion.manifest.get("inserted", [])]
    first = max([int(taken.max(initial=0)), *before]) + 1
    rows, outside = prescribed_table(
        paths,
        surface,
        steps=int(motion.manifest["steps"]),
        step_s=motion.step_s,
        first_track=first,
    )
    both = pa.concat_tables([motion.actors, rows]).combine_chunks()
    order = np.lexsort([both["track"].to_numpy(), both["time_s"].to_numpy()])
    tracks = tuple(range(first, first + len(paths)))
    manifest = dict(motion.manifest)
    manifest["inserted"] = [
        *manifest.get("inserted", []),
        *(
            {
                "track": track,
                "class": path.actor_class,
                "asset": path.asset,
                "from_s": float(path.time_s[0]),
                "to_s": float(path.time_s[-1]),
            }
            for track, path in zip(tracks, paths, strict=True)
        ),
    ]
    manifest["poses_outside_ground"] = manifest.get("poses_outside_ground", 0) + outside
    manifest["classes"] = _counted(manifest.get("classes", {}), rows)
    added = Motion(manifest, rows, motion.signals, motion.meshes).with_meshes().meshes
    both = both.take(order).combine_chunks()
    meshes = {**added, **motion.meshes}
    return replace(motion, manifest=manifest, rows=as_rows(both), meshes=meshes), tracks


def _counted(classes: dict[str, dict[str, float]], rows: pa.Table) -> dict[str, dict[str, float]]:
    """Return the counts of a manifest with those who are seen besides."""
    tracks = rows.group_by(["track", "class"]).aggregate([])
    counted = {name: dict(row) for name, row in classes.items()}
    known = next(iter(classes.values()), {"seen": 0})
    for name, count in Counter(tracks["class"].to_pylist()).items():
        row = counted.setdefault(name, dict.fromkeys(known, 0))
        row["seen"] = row["seen"] + count
    return counted
