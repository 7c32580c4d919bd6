"""Packets of a twin: triangles, lanes, signals, coverage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from urbantwin.artefact.arrays import ArrayOf, read_arrays
from urbantwin.drawing.surface_colours import surface_colours
from urbantwin.geometry import Pose
from urbantwin.taxonomy import materials, semantic_classes
from urbantwin.traffic import Motion
from urbantwin.twin import Twin
from urbantwin.web.packet import packet, quantised

__all__ = ["coverage_packet", "lanes_packet", "twin_packet"]

#: Colours that differ by less than this (of 255) are merged.
_SHADE = 12
_COVERAGE_FORM = {
    "x0": ArrayOf("f8", ()),
    "y0": ArrayOf("f8", ()),
    "cell_m": ArrayOf("f8", (), least=1e-3),
    "height_m": ArrayOf("f4", ("corners up", "corners across")),
    "rate_hz": ArrayOf("f8", (), least=1e-3),
    "facing": ArrayOf("f4", ("S", "rows", "columns")),
}
#: Height of drawn signals above their stop lines, metres.
_HEAD_M = 3.5


def twin_packet(twin: Twin, scene_SE3_site: Pose | None) -> bytes:
    """Return the packet of a twin's triangles, sorted by class, material and colour."""
    mesh = twin.mesh
    colour = np.rint(surface_colours(mesh, twin.colours) ** (1 / 2.2) * 255).astype(np.int64)
    shade = np.clip((colour // _SHADE) * _SHADE + _SHADE // 2, 0, 255)
    keys = np.column_stack([mesh.semantic, mesh.material, shade]).astype(np.int64)
    order = np.lexsort(keys.T[::-1])
    keys, faces = keys[order], mesh.faces[order]
    changes = np.r_[True, (keys[1:] != keys[:-1]).any(axis=1)][: len(keys)]
    begins = np.flatnonzero(changes).tolist()
    names = {one.id: one.name for one in semantic_classes().values()}
    kinds = list(materials())
    groups: list[dict[str, Any]] = []
    for first, last in zip(begins, [*begins[1:], len(keys)], strict=True):
        semantic, material, *rgb = (int(one) for one in keys[first])
        groups.append(
            {
                "class": names.get(semantic, "unlabelled"),
                "material": kinds[material] if material < len(kinds) else "unknown",
                "colour": rgb,
                "first": int(first),
                "count": int(last - first),
            }
        )
    used, index = np.unique(faces, return_inverse=True)
    places = mesh.vertices[used]
    if scene_SE3_site is not None:
        places = scene_SE3_site.apply(places)
    header, position = quantised(places)
    arrays = {"position": position, "index": index.reshape(-1, 3).astype(np.uint32)}
    return packet({**header, "groups": groups}, arrays)


def lanes_packet(twin: Twin, motion: Motion | None, scene_SE3_site: Pose | None) -> bytes:
    """Return the packet of a twin's lanes, with a motion's signal states."""

    def line(places: NDArray[np.float64]) -> list[list[float]]:
        moved = places if scene_SE3_site is None else scene_SE3_site.apply(places)
        return [[round(float(one), 3) for one in place] for place in moved]

    lanes = []
    for lane in twin.roads.lanes:
        centre = np.asarray(lane.centre, float).reshape(-1, 3)
        if len(centre) < 2:
            continue
        half = (lane.widths if len(lane.widths) else np.full(len(centre), lane.width)) / 2
        ahead = np.gradient(centre[:, :2], axis=0)
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
        side = np.column_stack([-ahead[:, 1], ahead[:, 0], np.zeros(len(centre))]) * half[:, None]
        lanes.append(
            {
                "kind": lane.kind,
                "name": lane.id,
                "line": line(centre),
                "left": line(centre + side),
                "right": line(centre - side),
            }
        )
    return packet({"lanes": lanes, "signals": _signals(twin, motion, line)}, {})


def _signals(twin: Twin, motion: Motion | None, line: Any) -> list[dict[str, Any]]:  # noqa: ANN401
    if motion is None or not motion.signals.num_rows:
        return []
    found: dict[tuple[str, int, float, float], list[list[Any]]] = {}
    for row in motion.signals.to_pylist():
        key = (row["signal"], row["link"], row["x"], row["y"])
        found.setdefault(key, []).append([round(row["time_s"], 4), row["state"]])
    places = np.array([key[2:] for key in found], float).reshape(-1, 2)
    ground = np.nan_to_num(np.asarray(twin.elevation.raw_at(places), float)).reshape(-1)
    at = line(np.column_stack([places, ground + _HEAD_M]))
    return [
        {"at": place, "link": key[1], "states": states}
        for place, (key, states) in zip(at, found.items(), strict=True)
    ]


def coverage_packet(folder: Path) -> bytes:
    """Return the packet of a rig's point density on upright surfaces, site frame.

    Args:
        folder: folder of a coverage, written by ``urbantwin rig coverage``.

    Raises:
        InputError: the folder is not a coverage.
    """
    found = read_arrays(folder / "coverage.npz", "the maps of a coverage", _COVERAGE_FORM)
    value = found["facing"].sum(axis=0) / float(found["rate_hz"])
    header = {
        "x0": float(found["x0"]),
        "y0": float(found["y0"]),
        "cell_m": float(found["cell_m"]),
        "unit": "points per m² and frame, on what stands upright",
    }
    arrays = {"value": value.astype(np.float32), "z": found["height_m"].astype(np.float32)}
    return packet(header, {name: np.nan_to_num(values) for name, values in arrays.items()})
