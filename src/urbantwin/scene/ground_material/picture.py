"""Classifying imagery into layers of the ground's materials."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from urbantwin.geometry import LabelledMesh, MaterialLayer
from urbantwin.scene.ground_material.land_cover import covers_in_picture, means
from urbantwin.scene.ground_material.paint_in_picture import paint_in_picture
from urbantwin.scene.ground_material.rasterise import layer_of_cells
from urbantwin.scene.ground_material.visible_ground import (
    CARRIAGEWAY,
    VisibleGround,
    visible_ground,
)
from urbantwin.site import Orthophoto
from urbantwin.taxonomy import material_id, materials

__all__ = ["PictureMaterials", "picture_materials"]

#: Cells of covers, metres, unless the picture is coarser.
COVER_M = 0.25
#: The coarsest picture in which a line 0.15 m wide can be seen, metres a pixel.
PAINT_PIXEL_M = 0.25
#: Limits of paint in a usable picture: a smaller share of the lane model's paint means that paint
#: is not visible (worn, blurred, or newer than the picture); a larger share of the road means that
#: other objects were detected.
LEAST_PAINT, MOST_PAINT = 0.25, 0.2

#: Heights (N,) of a level's surface at points (N, 2), and the level of points (N, 3).
LevelHeight = Callable[[NDArray[np.float64], int], NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class PictureMaterials:
    """Materials classified in imagery.

    Attributes:
        layers: paint first, then covers.
        photo: the picture.
        clear: (ny, nx) True where paint on a carriageway would be visible.
        uses_paint: whether its paint is used instead of the lane model's.
        notes: counts, for the manifest.
    """

    layers: tuple[MaterialLayer, ...]
    photo: Orthophoto
    clear: NDArray[np.bool_]
    uses_paint: bool
    notes: dict[str, object]

    def shows(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return for which points (N, 2) the paint of the picture is used."""
        if not self.uses_paint:
            return np.zeros(len(points), bool)
        photo = self.photo
        at = np.floor((points - [photo.x0, photo.y0]) / photo.cell_m).astype(np.int64)
        ny, nx = self.clear.shape
        inside = (at >= 0).all(axis=1) & (at[:, 0] < nx) & (at[:, 1] < ny)
        found = np.zeros(len(points), bool)
        found[inside] = self.clear[at[inside, 1], at[inside, 0]]
        return found


def picture_materials(
    photo: Orthophoto,
    mesh: LabelledMesh,
    levels: tuple[int, ...],
    height: LevelHeight,
    modelled: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
) -> PictureMaterials:
    """Classify a picture.

    Args:
        photo: the picture.
        mesh: the static scene, to find the visible ground.
        levels: levels of the roads, from the ground up.
        height: height of the ground (level 0) and of the roads above it.
        modelled: function that returns which points (N, 2) have paint in the lane model.
    """
    factor = max(1, round(COVER_M / photo.cell_m))
    photo = _aligned(photo, factor)
    cell_m = factor * photo.cell_m
    shape = (photo.known.shape[0] // factor, photo.known.shape[1] // factor)
    seen = visible_ground(mesh, photo.x0, photo.y0, cell_m, shape)
    road = _finer(seen.zone == CARRIAGEWAY, factor, photo.known.shape) & photo.known
    found = paint_in_picture(photo.rgb, road, photo.cell_m)
    clear = road & ~found.unclear
    uses_paint, notes = _compared(photo, found.paint, clear, modelled)

    near_paint = binary_dilation(found.paint, np.ones((3, 3), bool))
    light, known = means(photo.rgb, photo.known & ~near_paint & ~found.unclear, factor)
    cover = covers_in_picture(light, known, seen.zone, cell_m)
    own = seen.material == cover
    grid = _Grid(photo.x0, photo.y0, levels, height)
    layers = []
    if uses_paint:
        layers += grid.layers(found.paint, "road-paint", photo.cell_m, seen, factor)
    for number in np.unique(cover[~own & (cover > 0)]):
        name = next(m.name for m in materials().values() if m.id == number)
        layers += grid.layers((cover == number) & ~own, name, cell_m, seen, 1)
    area = {
        name: round(float((cover == material_id(name)).sum()) * cell_m**2, 1)
        for name in sorted({m.name for m in materials().values() if m.id in np.unique(cover)})
        if name != "unknown"
    }
    told = float((cover > 0).sum()) / max(1, int((seen.zone > 0).sum()))
    notes |= {"told_share_of_ground": round(told, 3), "covers_m2": area}
    return PictureMaterials(tuple(layers), photo, clear, uses_paint, notes)


def _aligned(photo: Orthophoto, factor: int) -> Orthophoto:
    """Return the picture cropped to start at whole cells of ``factor`` pixels."""
    first = np.rint(np.array([photo.x0, photo.y0]) / photo.cell_m).astype(np.int64)
    skip = -first % factor
    x0, y0 = (float(v) for v in (first + skip) * photo.cell_m)
    inside = slice(int(skip[1]), None), slice(int(skip[0]), None)
    return replace(photo, x0=x0, y0=y0, rgb=photo.rgb[inside], known=photo.known[inside])


def _finer(mask: NDArray[np.bool_], factor: int, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a mask of coarse cells as a mask of pixels; False outside the coarse cells."""
    out = np.zeros(shape, bool)
    fine = mask.repeat(factor, axis=0).repeat(factor, axis=1)
    out[: fine.shape[0], : fine.shape[1]] = fine
    return out


def _compared(
    photo: Orthophoto,
    paint: NDArray[np.bool_],
    clear: NDArray[np.bool_],
    modelled: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
) -> tuple[bool, dict[str, object]]:
    """Return whether the picture's paint is plausible, and its comparison with the model's."""
    rows, columns = np.nonzero(clear)
    points = np.column_stack([columns, rows]) + 0.5
    model = int(modelled(points * photo.cell_m + [photo.x0, photo.y0]).sum())
    seen = int(paint.sum())
    cell = photo.cell_m**2
    notes: dict[str, object] = {
        "paint_seen_m2": round(seen * cell, 1),
        "paint_of_lane_model_there_m2": round(model * cell, 1),
    }
    why = ""
    if photo.source_cell_m > PAINT_PIXEL_M:
        why = f"pixels of {photo.source_cell_m:.2f} m are too coarse for lane marks"
    elif model and seen < LEAST_PAINT * model:
        why = f"it shows {seen / model:.2f} times as much"
    elif seen > MOST_PAINT * len(points):
        why = f"{seen / len(points):.0%} of the road looks like paint"
    notes["paint"] = f"of the lane model: {why}" if why else "of the picture where it is clear"
    return not why, notes


@dataclass(frozen=True)
class _Grid:
    x0: float
    y0: float
    levels: tuple[int, ...]
    height: LevelHeight

    def layers(
        self, mask: NDArray[np.bool_], name: str, cell_m: float, seen: VisibleGround, factor: int
    ) -> list[MaterialLayer]:
        """Return a layer per level of a mask's cells, ``factor`` of them per cell of ``seen``.

        The grid starts at a whole cell, and layers count cells from the site's origin.
        """
        rows, columns = np.nonzero(mask)
        first = np.rint(np.array([self.x0, self.y0]) / cell_m).astype(np.int64)
        cells = np.column_stack([columns, rows]) + first
        z = seen.z[rows // factor, columns // factor]
        middle = np.asarray((cells + 0.5) * cell_m, np.float64)
        level = np.zeros(len(cells), np.int64)
        for above in self.levels[1:]:
            level[np.abs(z - self.height(middle, above)) < 1.0] = above
        return [
            layer_of_cells(
                cells[level == one],
                material=material_id(name),
                level=one,
                cell_m=cell_m,
                height=_On(self.height, one),
            )
            for one in np.unique(level).tolist()
        ]


@dataclass(frozen=True)
class _On:
    height: LevelHeight
    level: int

    def __call__(self, xy: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.height(xy, self.level)
