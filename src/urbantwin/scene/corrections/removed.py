"""Trees, poles and walls removed by the user: mapped and assumed ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Geometry

from urbantwin.geometry import LabelledMesh
from urbantwin.site import OsmFeature
from urbantwin.site.corrections import Correction, Outcome, RemoveThing
from urbantwin.taxonomy import semantic_id

__all__ = ["without_barriers", "without_things"]

#: A point without a radius removes the nearest object, if it is within this, metres.
NEAREST_M = 3.0
#: Meshes that contain the objects, and the class whose faces give their position.
_STAND_IN = {
    "tree": (("trees", "surveyed trees"), "trunk"),
    "pole": (("poles",), "pole"),
}
Built = tuple[LabelledMesh, dict[str, int]]


def without_barriers(
    features: Sequence[OsmFeature], corrections: Sequence[Correction]
) -> tuple[list[OsmFeature], list[Outcome]]:
    """Return features without removed walls, fences and hedges, and the result of each removal.

    Args:
        features: mapped and assumed features, site frame.
        corrections: the corrections; other kinds are ignored.
    """
    kept, outcomes = list(features), []
    for one in corrections:
        if not isinstance(one.asked, RemoveThing) or one.asked.what != "wall":
            continue
        area = shapely.union_all([shape.buffer(one.asked.radius_m or 0.0) for shape in one.shapes])
        rest: list[OsmFeature] = []
        cut_m, nearest = 0.0, (np.inf, "")
        for feature in kept:
            if "barrier" not in feature.tags:
                rest.append(feature)
                continue
            gap = float(shapely.distance(feature.geometry, area))
            named = f"{feature.kind}/{feature.id}" if feature.id > 0 else "an assumed one"
            nearest = min(nearest, (gap, named))
            if gap > 0:
                rest.append(feature)
                continue
            line = feature.geometry
            if line.geom_type.endswith("Polygon"):
                line = line.boundary
            cut_m += shapely.length(shapely.intersection(line, area))
            parts = shapely.get_parts(shapely.difference(line, area))
            rest += [
                replace(feature, geometry=part) for part in parts if part.geom_type == "LineString"
            ]
        if cut_m > 0 or len(rest) < len(kept):
            outcomes.append(
                Outcome(one, True, f"{cut_m:.1f} m of walls, fences and hedges left out")
            )
        else:
            gap, named = nearest
            near = f"; the nearest ({named}) is {gap:.1f} m away" if np.isfinite(gap) else ""
            outcomes.append(Outcome(one, False, f"no wall, fence or hedge is there{near}"))
        kept = rest
    return kept, outcomes


def without_things(
    objects: Mapping[str, Built], corrections: Sequence[Correction]
) -> tuple[dict[str, Built], list[Outcome]]:
    """Return meshes without the removed trees and poles, and the result of each removal.

    Args:
        objects: meshes by subject, ``part`` 1, 2, ... per object, and counts.
        corrections: the corrections; other kinds are ignored.
    """
    left = dict(objects)
    outcomes = [
        _removed(left, one, one.asked)
        for one in corrections
        if isinstance(one.asked, RemoveThing) and one.asked.what in _STAND_IN
    ]
    return left, outcomes


def _removed(left: dict[str, Built], one: Correction, asked: RemoveThing) -> Outcome:
    names, kind = _STAND_IN[asked.what]
    standing = [
        (name, part, foot)
        for name in names
        if name in left
        for part, foot in _feet(left[name][0], semantic_id(kind)).items()
    ]
    xy = np.array([foot for _, _, foot in standing]).reshape(-1, 2)
    gone: set[int] = set()
    nearest = np.inf
    for shape in one.shapes:
        away = shapely.distance(shape, shapely.points(xy))
        nearest = min(nearest, float(away.min(initial=np.inf)))
        if shape.geom_type == "Point" and asked.radius_m is None:
            if len(away) and away.min() <= NEAREST_M:
                gone.add(int(away.argmin()))
        else:
            gone |= set(np.flatnonzero(away <= (asked.radius_m or 0.0)).tolist())
    if not gone:
        near = f"; the nearest is {nearest:.1f} m away" if np.isfinite(nearest) else ""
        return Outcome(one, False, f"no {asked.what} stands there{near}{_of_lanes(left, one)}")
    for name in names:
        parts = [standing[k][1] for k in gone if standing[k][0] == name]
        if parts:
            mesh, counts = left[name]
            counts = {**counts, "removed by corrections": len(parts)}
            left[name] = mesh.select(~np.isin(mesh.part, parts)), counts
    at = [shapely.Point(xy[k]) for k in sorted(gone)]
    many = f"{len(gone)} {asked.what}{'' if len(gone) == 1 else 's'}"
    return Outcome(one, True, f"{many} left out", at)


def _of_lanes(left: Mapping[str, Built], one: Correction) -> str:
    """Return a hint if there is a pole of signals or of the lanes' signs."""
    mesh = left["signals"][0] if "signals" in left else LabelledMesh.empty()
    xy = np.array(list(_feet(mesh, semantic_id("pole")).values())).reshape(-1, 2)
    drawn: Geometry = shapely.GeometryCollection(list(one.shapes))
    if shapely.distance(drawn, shapely.points(xy)).min(initial=np.inf) > NEAREST_M:
        return ""
    return "; signals and signs of lanes are removed by their element of the map"


def _feet(mesh: LabelledMesh, semantic: int) -> dict[int, NDArray[np.float64]]:
    """Return the position in plan of each part of a mesh that has faces of a class."""
    faces, part = mesh.faces[mesh.semantic == semantic], mesh.part[mesh.semantic == semantic]
    order = np.argsort(part, kind="stable")
    numbers, starts = np.unique(part[order], return_index=True)
    feet = {}
    for number, corners in zip(numbers.tolist(), np.split(faces[order], starts[1:]), strict=False):
        points = mesh.vertices[np.unique(corners)]
        low = points[points[:, 2] < points[:, 2].min() + 0.05]
        feet[int(number)] = low[:, :2].mean(axis=0)
    return feet
