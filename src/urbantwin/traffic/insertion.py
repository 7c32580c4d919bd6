"""Insertion of actors into a motion; all existing rows stay unchanged."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa

from urbantwin.errors import StageError
from urbantwin.traffic.motion import Motion
from urbantwin.traffic.motion_rows import as_rows
from urbantwin.traffic.prescribed import PrescribedPath, TwinSurface, prescribed_table

__all__ = ["Insertion", "inserted"]


@dataclass(frozen=True, eq=False)
class Insertion:
    """Actors to add to a motion.

    Attributes:
        paths: their paths.
        first: track id of the first.
        rows: their rows of the table of actors.
        outside: number of poses beside the ground, which are left out.
    """

    paths: tuple[PrescribedPath, ...]
    first: int
    rows: pa.Table
    outside: int

    @classmethod
    def of(cls, motion: Motion, paths: Sequence[PrescribedPath], surface: TwinSurface) -> Insertion:
        """Return the actors with their rows and track ids for a motion; see `inserted`."""
        tracks = motion.rows.distinct(["track"])["track"].to_numpy()
        before = [row["track"] for row in motion.manifest.get("inserted", [])]
        first = max([int(tracks.max(initial=0)), *before]) + 1
        steps = int(motion.manifest["steps"])
        rows, outside = prescribed_table(
            paths, surface, steps=steps, step_s=motion.step_s, first_track=first
        )
        return cls(tuple(paths), first, rows, outside)

    @property
    def tracks(self) -> tuple[int, ...]:
        """Their track ids."""
        return tuple(range(self.first, self.first + len(self.paths)))

    def into(self, motion: Motion) -> Motion:
        """Return the motion that they were made for, with them added."""
        both = pa.concat_tables([motion.actors, self.rows]).combine_chunks()
        order = np.lexsort([both["track"].to_numpy(), both["time_s"].to_numpy()])
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
                for track, path in zip(self.tracks, self.paths, strict=True)
            ),
        ]
        manifest["poses_outside_ground"] = manifest.get("poses_outside_ground", 0) + self.outside
        manifest["classes"] = _counted(manifest.get("classes", {}), self.rows)
        added = Motion(manifest, self.rows, motion.signals, motion.meshes).with_meshes().meshes
        both = both.take(order).combine_chunks()
        meshes = {**added, **motion.meshes}
        return replace(motion, manifest=manifest, rows=as_rows(both), meshes=meshes)


def inserted(
    motion: Motion,
    paths: Sequence[PrescribedPath],
    surface: TwinSurface,
    *,
    through_walls: bool = False,
) -> tuple[Motion, tuple[int, ...]]:
    """Return a motion with further actors, and their track ids.

    All other rows, the signals and the meshes stay byte-identical to those of ``motion``. No actor
    reacts to the added ones. Track ids continue after the highest of ``motion``, in the order of
    ``paths``; ``motion.json`` lists them under ``inserted``.

    Args:
        motion: the motion.
        paths: the actors to add; times before and after the motion are ignored.
        surface: surface of the motion's twin.
        through_walls: allow overlaps with the static scene.

    Raises:
        StageError: an actor overlaps a static object: a wall, a post, furniture.

    Example:
        >>> path = PrescribedPath("car", "car-sedan_black", np.array([0.0, 9.0]),
        ...                       np.array([[-40.0, -2.0], [40.0, -2.0]]))
        >>> changed, (track,) = inserted(motion, [path], TwinSurface(twin))
    """
    made = Insertion.of(motion, paths, surface)
    if not through_walls and (overlap := surface.solid.met_by(made.rows, motion.step_s)):
        raise StageError(f"cannot be inserted: {overlap}")
    return made.into(motion), made.tracks


def _counted(classes: dict[str, dict[str, float]], rows: pa.Table) -> dict[str, dict[str, float]]:
    """Return a manifest's counts per class, increased by the added actors."""
    tracks = rows.group_by(["track", "class"]).aggregate([])
    counted = {name: dict(row) for name, row in classes.items()}
    fields = next(iter(classes.values()), {"seen": 0})
    for name, count in Counter(tracks["class"].to_pylist()).items():
        row = counted.setdefault(name, dict.fromkeys(fields, 0))
        row["seen"] = row["seen"] + count
    return counted
