"""``boxes.parquet`` of a fleet: every actor at the frames' times, and its labels from each node."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.artefact.tables import PARQUET
from urbantwin.dataset.box_columns import box_rows
from urbantwin.dataset.fleet.node import Node
from urbantwin.dataset.frame_motion import FrameMotions
from urbantwin.dataset.layout import frame_name
from urbantwin.dataset.motion_interpolation import posed_actors
from urbantwin.dataset.reading.columns import (
    BOX,
    FLEET_BOXES,
    FLEET_BOXES_OF_NODE,
    VELOCITY,
    arrow_schema,
)
from urbantwin.geometry import LabelledMesh, wrapped
from urbantwin.lidar import PosedActor
from urbantwin.lidar.annotated import annotated_actors, annotated_size, truck_of_load
from urbantwin.lidar.compiled.boxes import tight_boxes
from urbantwin.lidar.labels import LEVELS
from urbantwin.lidar.standing import Standing, track_boxes
from urbantwin.traffic.assets import asset_mesh, mesh_among
from urbantwin.traffic.assets.truck_parts import mesh_of_part

if TYPE_CHECKING:
    from urbantwin.traffic import Motion
    from urbantwin.twin import Twin

__all__ = ["common_rows", "write_common_boxes"]
#: Reasons why a box does not count, in order of preference.
_IGNORED = ("unseen", "truncated", "far", "outside")
_LEVELS = tuple(level.name for level in LEVELS)

#: Return value of ``layout.write_frame`` by frame number.
Entries = Mapping[int, Mapping[str, Any]]


def write_common_boxes(
    path: Path,
    twin: Twin,
    motion: Motion,
    nodes: Sequence[Node],
    times_s: Mapping[int, float],
    entries: Mapping[str, Entries],
    seed: int,
) -> None:
    """Write the table.

    Args:
        path: the file.
        twin: the twin.
        motion: the motion.
        nodes: the nodes.
        times_s: frame number -> time, of the run.
        entries: name of each node -> number of each of its frames -> its entry.
        seed: seed of the run, for the drawn sizes of labels.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    from urbantwin.traffic.paths.coupling import towed_by

    parked, pulls = frozenset(motion.parked["track"].to_pylist()), towed_by(motion.rows)
    of_nodes = {
        f"{name}.{node.name}": kind for node in nodes for name, kind in FLEET_BOXES_OF_NODE.items()
    }
    schema = arrow_schema(FLEET_BOXES | of_nodes)
    boxes = _SiteBoxes(motion, nodes[0].rig.boxes, seed)
    motions = FrameMotions(motion)
    with pq.ParquetWriter(path, schema, **PARQUET) as writer:
        for index, time_s in times_s.items():
            around = motions.around(time_s, stop_s=motion.step_s)  # velocities follow the paths
            stood = boxes.at(posed_actors(around.rows, around.paths()))
            own = {node.name: entries[node.name].get(index) for node in nodes}
            rows = common_rows(stood, nodes, own, twin.region)
            for row in rows:
                track = row["track"]
                load_of = truck_of_load(track) if row["class"] == "trailer" else None
                row |= {
                    "frame": frame_name(index),
                    "time_s": time_s,
                    "parked": track in parked,
                    "towed_by": pulls.get(track, load_of),
                }
            writer.write_table(pa.Table.from_pylist(rows, schema=schema))


def common_rows(
    stood: Sequence[tuple[PosedActor, Any]],
    nodes: Sequence[Node],
    entries: Mapping[str, Mapping[str, Any] | None],
    region: shapely.Polygon | None,
) -> list[dict[str, Any]]:
    """Return the rows of one frame.

    Args:
        stood: the actors, each with its box (7,) in the site.
        nodes: the nodes.
        entries: entry of each node's frame; ``None``: the node is absent.
        region: area where labels count.
    """
    of_nodes = {
        name: {box["track"]: box for box in box_rows(entry["boxes"])}
        for name, entry in entries.items()
        if entry is not None
    }
    carried = {node.rig.carrier: node.name for node in nodes if node.rig.carrier is not None}
    rows = []
    for actor, box in stood:
        seen = {name: own.get(actor.track) for name, own in of_nodes.items()}
        told = [one for one in seen.values() if one is not None]
        row: dict[str, Any] = {
            "track": actor.track,
            "class": actor.actor_class,
            **dict(zip(BOX, [*box[:6].tolist(), float(wrapped(box[6]))], strict=True)),
            **dict(zip(VELOCITY, (actor.velocity + 0.0).tolist(), strict=True)),
            "num_points": sum(one["num_points"] for one in told),
            "num_nodes": sum(one["num_points"] > 0 for one in told),
            "occlusion": _best(min, told, "occlusion"),
            "visibility": _best(max, told, "visibility"),
            "difficulty": next(
                (k for k in _LEVELS if any(o["difficulty"] == k for o in told)), None
            ),
            "ignored": _ignored(told, region, box),
            "carries": carried.get(actor.track),
        }
        for name, one in seen.items():
            if one is not None:
                row |= {f"{column}.{name}": one[column] for column in FLEET_BOXES_OF_NODE}
        rows.append(row)
    return rows


def _best(choose: Any, told: Sequence[Mapping[str, Any]], name: str) -> float | None:  # noqa: ANN401
    known = [float(one[name]) for one in told if one[name] is not None]
    return float(choose(known)) if known else None


def _ignored(
    told: Sequence[Mapping[str, Any]],
    region: shapely.Polygon | None,
    box: Any,  # noqa: ANN401
) -> str | None:
    """Return why an actor does not count for all nodes together: it counts if it does for one."""
    reasons = {reason["ignored"] for reason in told}
    if None in reasons:
        return None
    outside = region is not None and not shapely.contains_xy(region, box[0], box[1])
    return next(
        (reason for reason in _IGNORED if reason in reasons), "outside" if outside else "unseen"
    )


class _SiteBoxes:
    """Boxes of actors in the site, with the size of a rig's labels."""

    def __init__(self, motion: Motion, kind: str, seed: int) -> None:
        def mesh(asset: str, phase: int) -> LabelledMesh:
            return mesh_among(motion.meshes, asset, phase, asset_mesh)

        self._mesh = partial(mesh_of_part, mesh)
        self._kind, self._seed = kind, seed
        self._corners: dict[tuple[str, int], NDArray[np.float64]] = {}

    def at(self, actors: Sequence[PosedActor]) -> list[tuple[PosedActor, Any]]:
        """Return the labelled actors, by track, with the box (7,) of each at the frame's time."""
        found = sorted(annotated_actors(self._kind, actors), key=lambda one: one.track)
        if not found:
            return []
        sizes: list[tuple[float, float, float] | None] = [None] * len(found)
        if self._kind != "tight":
            sizes = [annotated_size(self._kind, one, self._seed) for one in found]
        # Only tight boxes need the mesh.
        hulls = [
            self._vertices(one) if size is None else np.zeros((1, 3))
            for one, size in zip(found, sizes, strict=True)
        ]
        rotation = np.array([one.site_SE3_asset.rotation for one in found])
        place = np.array([one.site_SE3_asset.translation for one in found])
        count = np.array([len(one) for one in hulls], np.int64)
        hull = np.ascontiguousarray(np.concatenate(hulls).T)
        boxes = tight_boxes(rotation, place, hull, np.cumsum(count) - count, count)
        standing = Standing(rotation, place, boxes)
        boxes = track_boxes(standing, sizes, [one.ahead_m for one in found])
        return list(zip(found, boxes + 0.0, strict=True))

    def _vertices(self, actor: PosedActor) -> NDArray[np.float64]:
        key = (actor.asset, actor.phase)
        if key not in self._corners:
            mesh = self._mesh(*key)
            self._corners[key] = np.asarray(mesh.vertices[np.unique(mesh.faces)], np.float64)
        return self._corners[key]
