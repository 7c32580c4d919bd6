"""Models transformed, turned z-up and merged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.reconstruct.model import ImportedModel, PointCloud, TriangleMesh

__all__ = ["joined", "moved", "point_sample"]

#: (x, y, z) of a y-up model is (x, -z, y) of a z-up one.
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
_SAMPLE = 10_000


def moved(model: ImportedModel, matrix: NDArray[np.float64], up: str | None = "z") -> ImportedModel:
    """Return a model turned z-up where it is y-up, and then moved by a matrix (4, 4)."""
    whole = matrix @ _UPRIGHT if model.up == "y" else matrix
    if np.array_equal(whole, np.eye(4)):
        return replace(model, up=up)
    mesh, cloud = model.mesh, model.cloud
    if mesh is not None:
        mesh = replace(mesh, vertices=mesh.vertices @ whole[:3, :3].T + whole[:3, 3])
        if np.linalg.det(whole[:3, :3]) < 0:
            mesh = replace(mesh, faces=np.ascontiguousarray(mesh.faces[:, ::-1]))
    if cloud is not None:
        cloud = replace(cloud, points=cloud.points @ whole[:3, :3].T + whole[:3, 3])
    return replace(model, mesh=mesh, cloud=cloud, up=up)


def point_sample(model: ImportedModel) -> NDArray[np.float64]:
    """Return some of a model's points, evenly through its file."""
    points = model.mesh.vertices if model.mesh is not None else None
    if points is None:
        assert model.cloud is not None
        points = model.cloud.points
    return points[:: max(1, len(points) // _SAMPLE)]


def joined(models: Sequence[ImportedModel], problems: Sequence[str] = ()) -> ImportedModel:
    """Return the parts of one model as one.

    Raises:
        InputError: they are in different systems.
    """
    if len(models) == 1:
        return replace(models[0], problems=(*models[0].problems, *problems))
    first = models[0]
    for other in models[1:]:
        if (other.crs, other.up, other.unit_m) != (first.crs, first.up, first.unit_m):
            names = f"{next(iter(first.files), '?')} and {next(iter(other.files), '?')}"
            raise InputError(f"parts {names} are in different systems", expected="one system")
        if other.geotag != first.geotag:
            raise InputError("parts have different geotags", expected="one geotag")
    meshes = [model.mesh for model in models if model.mesh is not None]
    clouds = [model.cloud for model in models if model.cloud is not None]
    return replace(
        first,
        mesh=TriangleMesh.concatenate(meshes) if meshes else None,
        cloud=_clouds(clouds) if clouds else None,
        problems=(*(text for model in models for text in model.problems), *problems),
        notes={"parts": len(models), **_summed([model.notes for model in models])},
        files={name: value for model in models for name, value in model.files.items()},
    )


def _summed(notes: Sequence[dict[str, object]]) -> dict[str, object]:
    """Add up the counts of parts; of what is no count the first is kept."""
    total: dict[str, object] = {}
    for one in notes:
        for key, value in one.items():
            known = total.get(key)
            if isinstance(value, int) and isinstance(known, int):
                total[key] = known + value
            elif isinstance(value, dict) and isinstance(known, dict):
                total[key] = dict(sorted(_summed([known, value]).items()))
            elif known is None:
                total[key] = value
    return total


def _clouds(clouds: Sequence[PointCloud]) -> PointCloud:
    def all_of(name: str) -> NDArray[np.generic] | None:
        values = [getattr(cloud, name) for cloud in clouds]
        return None if any(value is None for value in values) else np.concatenate(values)

    points = np.concatenate([cloud.points for cloud in clouds])
    return PointCloud(points, all_of("colour"), all_of("classification"), all_of("last"))  # type: ignore[arg-type]
