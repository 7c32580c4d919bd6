"""A contact sheet of the actor catalogue: every body in daylight, with its name and size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from urbantwin.drawing import style
from urbantwin.drawing.scene import Camera, render
from urbantwin.geometry import LabelledMesh
from urbantwin.progress import Progress, each, untold
from urbantwin.taxonomy import material_id, semantic_id

__all__ = ["ShownActor", "actor_sheet"]

#: Actors per row of the sheet; size of each, pixels; and height of the text under it.
ACROSS, PIXELS, TEXT = 8, (210, 140), 34
#: Field of view of a portrait, and share of the distance to its border that the actor fills.
_FIELD_DEG, _FILLED = 20.0, 0.92


@dataclass(frozen=True, eq=False)
class ShownActor:
    """An actor on the sheet: its mesh, and the two lines under it."""

    mesh: LabelledMesh
    name: str
    below: str


def actor_sheet(actors: Sequence[ShownActor], *, tell: Progress = untold) -> Figure:
    """Return the picture of actors, row by row, each filling its cell.

    Args:
        actors: in their order.
        tell: called with the share done (0..1) and the current task.
    """
    (wide, high), rows = PIXELS, -(-len(actors) // ACROSS)
    size = ACROSS * wide, rows * (high + TEXT) + 70
    figure = style.new_figure(size[0] / 100, size[1] / 100)
    style.title(
        figure, "Actors", f"{len(actors)} bodies of the catalogue", x=0.012, top=1 - 14 / size[1]
    )
    for number, actor in enumerate(each(list(actors), tell, "drawing actors")):
        row, column = divmod(number, ACROSS)
        top = size[1] - 70 - row * (high + TEXT)
        where = (column * wide / size[0], (top - high) / size[1], wide / size[0], high / size[1])
        axes = figure.add_axes(where)
        style.bare(axes)
        axes.imshow(_portrait(actor.mesh, number), interpolation="nearest", aspect="auto")
        x = (column * wide + 6) / size[0]
        figure.text(x, (top - high - 13) / size[1], actor.name, color=style.INK, fontsize=8)
        figure.text(x, (top - high - 25) / size[1], actor.below, color=style.MUTED, fontsize=7)
    return figure


def _filled(mesh: LabelledMesh, camera: Camera) -> float:
    """Return the extent of a mesh from the middle of a picture, as a share of the half width."""
    forward = np.asarray(camera.target) - camera.place
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    x, y, deep = ((mesh.vertices - camera.place) @ np.column_stack([right, up, forward])).T
    half = np.tan(np.radians(camera.field_deg) / 2)
    return float(max(np.abs(x / deep).max(), np.abs(y / deep).max() * PIXELS[0] / PIXELS[1]) / half)


def _portrait(mesh: LabelledMesh, number: int) -> NDArray[np.uint8]:
    """Return the picture of one actor on a plain ground."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    # The number of a part determines its paint.
    painted = replace(mesh, part=np.full(len(mesh.faces), number % 8 + 1, mesh.part.dtype))
    half = 60.0 * reach
    ground = LabelledMesh.build(
        np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
        semantic_id("sidewalk"),
        material_id("concrete"),
    )
    camera = Camera(
        target=middle,
        distance_m=4.0 * reach / np.tan(np.radians(_FIELD_DEG / 2)),
        azimuth_deg=-38.0,
        elevation_deg=16.0,
        field_deg=_FIELD_DEG,
    )
    for _ in range(3):
        camera = replace(camera, distance_m=camera.distance_m * _filled(mesh, camera) / _FILLED)
    return render(LabelledMesh.concatenate([painted, ground]), camera, *PIXELS)
