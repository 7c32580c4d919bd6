"""Recognition of vehicles among the objects on a street, by size, shape and position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_opening, find_objects, label, maximum_filter

from urbantwin.reconstruct.cleaning.street_surface import REACH_M, Street

__all__ = ["Blob", "find_blobs", "vehicle_kind"]

#: Minimum height of objects on the street: curbs are 0.15 m high, humps 0.12 m.
_SEED_M = 0.3
#: Height above which a cell belongs to a building, metres.
_TALLER_M = REACH_M - 0.3
#: Cell size above which thin objects cannot be separated, metres.
_COARSE_M = 0.35
#: Minimum share of a vehicle on the carriageway: many park with two wheels on the sidewalk.
_ON_ROAD = 0.4


@dataclass(frozen=True, eq=False)
class Blob:
    """An object on the street.

    Attributes:
        mask: (rows, columns) bool mask of its cells, in a window of the street's grid.
        row, column: origin of the window.
        outline: smallest rectangle around it in plan, metres.
        length, width, height: metres; the height is the 95th percentile.
        middle: (3,) centre, metres.
        on_road: share of its area on the carriageway; 1 if no roads are known.
        full: share of the rectangle that it fills.
        boxy: share of its cells that are nearly as high as its highest.
        relief: height variation of its ridge along it, metres.
        tall: it continues above the height of vehicles: a tree, a building, a pole.
    """

    mask: NDArray[np.bool_]
    row: int
    column: int
    outline: shapely.Polygon
    length: float
    width: float
    height: float
    middle: NDArray[np.float64]
    on_road: float
    full: float
    boxy: float
    relief: float
    tall: bool

    @property
    def size(self) -> NDArray[np.float64]:
        """Length, width and height, metres."""
        return np.array([self.length, self.width, self.height])


def find_blobs(street: Street, least_m: float = _SEED_M) -> list[Blob]:
    """Return the separate objects on a street.

    Args:
        street: heights on a grid.
        least_m: minimum height of an object, metres.
    """
    height = street.height
    above = height > least_m
    # Poles or mirrors do not connect a vehicle to its neighbours.
    if street.grid.step < _COARSE_M:
        above = binary_opening(above, np.ones((3, 3), bool))
    taller = np.pad(height > _TALLER_M, 1)
    number, count = label(above, np.ones((3, 3), int))
    met = np.zeros(count + 1, bool)
    met[np.unique(number[street.asked])] = True
    met[0] = False
    windows = find_objects(number)
    blobs = []
    for k in np.flatnonzero(met):
        rows, columns = windows[k - 1]
        mask = number[rows, columns] == k
        if mask.sum() * street.grid.step**2 > 400.0 or mask.shape[0] * mask.shape[1] > 400_000:
            continue  # a building or a wood
        blobs.append(_blob(street, taller, mask, rows.start, columns.start))
    return blobs


def _blob(
    street: Street, taller: NDArray[np.bool_], mask: NDArray[np.bool_], row: int, column: int
) -> Blob:
    step = street.grid.step
    window = (slice(row, row + mask.shape[0]), slice(column, column + mask.shape[1]))
    r, c = np.nonzero(mask)
    xy = np.column_stack(
        [
            street.grid.west + (column + c + 0.5) * step,
            street.grid.south + (row + r + 0.5) * step,
        ]
    )
    h = street.top[window][mask] - street.bare[window][mask]
    # The body extends on average half a cell beyond the outermost centres.
    hull = shapely.oriented_envelope(shapely.convex_hull(shapely.multipoints(xy)))
    outline = shapely.buffer(hull, step / 2, join_style="mitre")
    outline = shapely.oriented_envelope(outline)
    ring = shapely.get_coordinates(outline)
    sides = np.linalg.norm(np.diff(ring[:3], axis=0), axis=1)
    way = np.diff(ring[:3], axis=0)[int(np.argmax(sides))]
    length, width = float(sides.max()), float(sides.min())
    way = way / max(float(np.hypot(*way)), 1e-9)
    high = float(np.percentile(h, 95))
    # The ridge is the height of each 0.75 m section along the length.
    along = np.floor((xy - ring[0]) @ way / 0.75).astype(np.int64)
    along -= along.min()
    ridge = np.zeros(along.max() + 1)
    np.maximum.at(ridge, along, h)
    inner = ridge[1:-1] if len(ridge) > 4 else ridge
    on_road = float(street.asked[window][mask].mean()) if street.shape is not None else 1.0
    # Tall neighbouring cells: the object continues upwards.
    beside = taller[row : row + mask.shape[0] + 2, column : column + mask.shape[1] + 2]
    tall = bool(beside[maximum_filter(np.pad(mask, 1), 3)].sum() > 2)
    base = float(np.median(street.bare[window][mask]))
    return Blob(
        mask=mask,
        row=row,
        column=column,
        outline=outline,
        length=length,
        width=width,
        height=high,
        middle=np.array([*outline.centroid.coords[0], base + high / 2]),
        on_road=on_road,
        full=float(mask.sum() * step**2 / max(outline.area, 1e-9)),
        boxy=float((h > 0.7 * high).mean()),
        relief=float(np.percentile(inner, 90) - np.percentile(inner, 10)),
        tall=tall,
    )


@dataclass(frozen=True)
class _Kind:
    """Bounds of a kind of vehicle: length, width and height (min, max), metres, and shape."""

    name: str
    length: tuple[float, float]
    width: tuple[float, float]
    height: tuple[float, float]
    full: float = 0.6
    uneven: bool = False
    rough: bool = False

    def takes(self, blob: Blob) -> bool:
        bounds = zip(blob.size.tolist(), (self.length, self.width, self.height), strict=True)
        return (
            all(low <= value <= high for value, (low, high) in bounds)
            and blob.full > self.full
            and (not self.uneven or blob.relief > _RELIEF_M)
            and (not self.rough or (blob.boxy < 0.6 and blob.on_road > 0.9))
        )


#: Minimum relief of a row of cars, which has bonnets between roofs, unlike walls and hedges,
#: metres.
_RELIEF_M = 0.3
#: Cars 3.5-5.3 x 1.6-2.1 x 1.3-2.0 m, vans to 7 x 2.5 x 3 m; trucks and buses at most 18.75 x 2.55
#: x 4 m (EU 96/53/EC). A scan's blended edges and the grid's cells add up to half a metre; cells
#: lower than the seed height subtract as much. A smear is the trace of a moving car.
_KINDS = (
    _Kind("car", (2.6, 7.2), (1.3, 2.7), (1.0, 3.1)),
    _Kind("truck or bus", (5.5, 20.0), (1.8, 3.5), (1.9, REACH_M - 0.2)),
    _Kind("row of cars", (5.5, 80.0), (1.5, 2.8), (1.0, 3.1), full=0.5, uneven=True),
    _Kind("row of cars", (5.0, 80.0), (3.2, 6.2), (1.0, 2.3), uneven=True),
    _Kind("smear", (2.0, 20.0), (1.2, 3.2), (0.3, 1.6), full=0.4, rough=True),
)
#: Strict bounds for places without known roads.
_ANYWHERE = (_Kind("car", (3.0, 5.8), (1.4, 2.5), (1.1, 2.2), full=0.7),)


def vehicle_kind(blob: Blob, *, roads_known: bool) -> tuple[str, str]:
    """Return the kind of vehicle of a blob with its measures, or an empty kind with the reason.

    Args:
        blob: the object.
        roads_known: whether the carriageways are known; if not, only cars are recognised.
    """
    said = f"{blob.length:.1f} x {blob.width:.1f} x {blob.height:.1f} m"
    if roads_known:
        said += f", {blob.on_road:.0%} on the carriageway"
    if blob.tall:
        return "", f"{said}, goes on above vehicles"
    if blob.on_road < _ON_ROAD:
        return "", said
    for kind in _KINDS if roads_known else _ANYWHERE:
        if kind.takes(blob):
            return kind.name, said
    return "", f"{said}: no vehicle's size or shape"
