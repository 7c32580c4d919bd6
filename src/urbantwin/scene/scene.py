"""The static scene of a site as one labelled mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.geometry import DownwardProbe, LabelledMesh, PartColours
from urbantwin.ground import Elevation
from urbantwin.progress import Progress, between, untold
from urbantwin.reconstruct import Reconstruction
from urbantwin.roads import RoadNetwork, RoadSurface
from urbantwin.roads.signals import Head
from urbantwin.scene.building import building_mesh
from urbantwin.scene.catalogue import street_objects
from urbantwin.scene.clutter import assumed_features
from urbantwin.scene.corrections import added_things, without_barriers, without_things
from urbantwin.scene.deck import deck_area, deck_height, deck_mesh, deck_pier_mesh
from urbantwin.scene.dropped_curb import DroppedCurbs
from urbantwin.scene.map_objects import map_objects
from urbantwin.scene.surface import PARTS, Spacing, surface_mesh
from urbantwin.scene.swept_lanes import SweptLanes
from urbantwin.scene.tree import surveyed_tree_mesh
from urbantwin.scene.water import water_bodies, with_water
from urbantwin.scene.zones import Zone, ground_zones
from urbantwin.site import Clutter, OsmFeature
from urbantwin.site.corrections import Correction, Outcome

__all__ = ["FIRST_OBJECT", "Scene", "build_scene", "with_measured_curbs"]

#: Sizes of cells, each half of the previous size, metres; and the maximum deviation of the ground
#: from the plane of a cell's corners, above which the cell is halved.
_CELLS_M = (4.0, 2.0, 1.0, 0.5, 0.25)
_OFF_M = 0.008


def bending_ground(elevation: Elevation, measured: shapely.Geometry) -> NDArray[np.float64]:
    """Return the corners (N, 2) of cells sized to the shape of the ground.

    Cells of 4 m are halved, down to the grid of the heights, while the ground in them deviates more
    than 8 mm from the surface through their corners.

    Args:
        elevation: the ground.
        measured: area with measured heights; outside it nothing is returned.
    """
    if measured.is_empty:
        return np.zeros((0, 2))
    shapely.prepare(measured)
    west, south, east, north = measured.bounds
    first = np.floor(np.array([west, south]) / _CELLS_M[0]).astype(int)
    last = np.ceil(np.array([east, north]) / _CELLS_M[0]).astype(int)
    grid = np.stack(np.meshgrid(*map(np.arange, first, last)), axis=-1).reshape(-1, 2)
    corner = grid * _CELLS_M[0]
    found = []
    for size in _CELLS_M:
        middle = corner + size / 2
        near = shapely.dwithin(measured, shapely.points(middle), size * 0.75)
        corner = corner[near]
        if size < elevation.step or not len(corner):
            break
        found.append(_corners(corner, size).reshape(-1, 2))
        bent = corner[_off(elevation, corner, size) > _OFF_M]
        corner = _corners(bent, size / 2).reshape(-1, 2)
    points = np.unique(np.round(np.concatenate(found), 3), axis=0)
    inside: NDArray[np.float64] = points[shapely.contains_xy(measured, points[:, 0], points[:, 1])]
    return inside


def _corners(corner: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the corners (N, 4, 2) of cells from their lower left corners."""
    return np.asarray(corner[:, None] + size * np.array([[0, 0], [1, 0], [0, 1], [1, 1]]))


def _off(elevation: Elevation, corner: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return the maximum deviation (N,) of the ground in cells from their corners, metres."""
    share = np.linspace(0, 1, max(3, round(size / elevation.step) + 1))
    u, v = (grid.ravel() for grid in np.meshgrid(share, share))
    weight = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v])
    at_corners = elevation.raw_at(_corners(corner, size).reshape(-1, 2)).reshape(-1, 4)
    inner = corner[:, None] + size * np.column_stack([u, v])
    there = elevation.raw_at(inner.reshape(-1, 2)).reshape(len(corner), -1)
    return np.asarray(np.abs(there - at_corners @ weight).max(axis=1))


#: Distance of the points at which heights are compared, metres, and their minimum number.
_STEP_M, _FEWEST = 0.5, 20
#: No curb is lower or higher, metres.
_LOWEST_M, _HIGHEST_M = 0.01, 0.3

_Heights = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def with_measured_curbs(
    zones: Sequence[Zone],
    measured: shapely.Geometry,
    road_height: _Heights,
    ground_height: _Heights,
) -> list[Zone]:
    """Return zones with raised pieces at their measured height above the carriageway.

    The height of a piece is the median of the measured ground above the road's height beside it.
    Pieces without measurements keep the usual curb height.

    Args:
        zones: the zones.
        measured: area in which the ground was measured at close range.
        road_height: height of the carriageway, extrapolated beyond it, at (N, 2) points.
        ground_height: measured height, at (N, 2) points.
    """
    found: list[Zone] = []
    shapely.prepare(measured)
    for zone in zones:
        if not zone.step or not shapely.intersects(measured, zone.area):
            found.append(zone)
            continue
        for piece in shapely.get_parts(zone.area):
            low, high = np.reshape(piece.bounds, (2, 2))
            axes = [np.arange(a + _STEP_M / 2, b, _STEP_M) for a, b in zip(low, high, strict=True)]
            at = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
            at = at[shapely.contains_xy(piece, *at.T)]
            at = at[shapely.contains_xy(measured, *at.T)]
            above = ground_height(at) - road_height(at) if len(at) else np.zeros(0)
            above = above[np.isfinite(above)]
            step = None
            if len(above) >= _FEWEST:
                step = float(np.clip(np.median(above), _LOWEST_M, _HIGHEST_M))
            found.append(replace(zone, area=piece, measured_step_m=step))
    return found


#: ``part`` numbers below this are the ground's (``surface.PARTS``); the others are objects'.
FIRST_OBJECT = 16
#: Share of the time after which zones, ground and buildings of a district are built.
ZONES, SURFACE, BUILDINGS = 0.28, 0.63, 0.72
#: Approximate overhang of turning buses over kerbs, metres.
SWING_M = 1.2
#: Objects kept where they are on a lane: buildings, and objects measured there.
_NOT_CLEARED = {"buildings", "imported", "surveyed trees"}
#: Largest triangles; roads are finer where their height requires it, terrain on hills is finer.
ON_A_HILL = Spacing(road=25.0, terrain=5.0)
ON_A_PLAIN = Spacing(road=25.0, terrain=10.0)


@dataclass(frozen=True)
class Scene:
    """The static scene.

    Attributes:
        mesh: its triangles.
        notes: counts and assumptions of its creation.
        colours: colours of its buildings.
        corrected: results of the corrections of objects.
    """

    mesh: LabelledMesh
    notes: dict[str, object]
    colours: PartColours
    corrected: tuple[Outcome, ...] = ()

    def save(self, folder: Path) -> None:
        """Write the mesh and the colours into a twin's folder."""
        self.mesh.save(folder / "scene.npz")
        self.colours.save(folder / "colours.npz")


def build_scene(  # noqa: PLR0913 - all that a scene is made of
    network: RoadNetwork,
    surface: RoadSurface,
    elevation: Elevation,
    region: shapely.Polygon,
    features: Sequence[OsmFeature],
    heads: Sequence[Head] = (),
    imported: Reconstruction | None = None,
    drivable: shapely.Geometry | None = None,
    *,
    country: str = "",
    clutter: Clutter = "mapped",
    sensors: Sequence[tuple[float, float]] = (),
    corrections: Sequence[Correction] = (),
    own_objects: Path | None = None,
    tell: Progress = untold,
) -> Scene:
    """Build ground, decks, buildings and street furniture.

    Args:
        network: the lanes.
        surface: height of the roads.
        elevation: the ground's heights.
        region: region of interest, site frame.
        features: the map's features that touch the region.
        heads: signals and signs of the lane model, with their positions.
        imported: imported geometry; it replaces the mapped objects in its area.
        drivable: area mapped as drivable beyond the lanes.
        country: ISO 3166-1 alpha-2; empty if unknown.
        clutter: objects beside the streets: barriers and furniture as ``mapped``, with ``typical``
            objects where none are mapped, or ``none``.
        sensors: east and north of sensors; near them no objects are assumed, metres.
        corrections: objects added and removed by the user; other kinds of corrections are ignored.
        own_objects: the user's own street objects, see ``docs/howto/street_objects.md``.
        tell: called with the share done (0..1) and the current task.
    """
    covers = imported.covers if imported else {}
    spacing = ON_A_PLAIN if elevation.is_flat and len(network.levels) == 1 else ON_A_HILL
    waters = water_bodies(features, region)
    if drivable is None and imported is not None and not network.lanes:
        drivable = _paved_when_unmapped(imported.measured)
    zones = ground_zones(
        network, region, features, waters, drivable, country, between(tell, 0.0, ZONES, "zones")
    )
    if imported is not None and not imported.measured.is_empty:
        zones = with_measured_curbs(zones, imported.measured, surface.height, elevation.raw_at)
    ground = surface_mesh(
        zones,
        road_height=surface.height,
        terrain_height=with_water(elevation.raw_at, waters, region),
        spacing=spacing,
        lines=surface.ridges(0),
        drops=DroppedCurbs.of_network(network, 0),
        bends=bending_ground(elevation, imported.measured) if imported else None,
        tell=between(tell, ZONES, SURFACE, "ground"),
    )
    decks = deck_mesh(network, surface, spacing)
    probe = DownwardProbe(ground)

    def ground_height(xy: NDArray[np.float64]) -> NDArray[np.float64]:
        high = np.column_stack([xy, np.full(len(xy), ground.vertices[:, 2].max() + 1.0)])
        found = probe.height_below(high)
        return np.where(np.isnan(found), elevation.raw_at(xy), found)

    carriageway = shapely.union_all([z.area for z in zones if z.kind == "carriageway"])
    beside, assumed = list(features), dict[str, int]()
    if clutter == "typical":
        beside, assumed = assumed_features(
            features, zones, _kept_free(network), region, country, sensors
        )
    if clutter == "none":  # bollards are built with the poles
        beside = [f for f in beside if f.tags.get("barrier") != "bollard"]
    beside, outcomes = without_barriers(beside, corrections)
    buildings = building_mesh(
        features,
        region=region,
        ground_height=ground_height,
        carriageway=carriageway,
        without=covers.get("buildings"),
        country=country,
        tell=between(tell, SURFACE, BUILDINGS, "buildings"),
    )
    deck_heights = deck_height(network, surface, ground_height)
    swept = SweptLanes(network)
    decks, parapets = swept.clear(decks)
    cleared = {"decks": parapets}
    objects: dict[str, tuple[LabelledMesh, dict[str, int]]] = {
        "buildings": (buildings.mesh, buildings.notes),
        **map_objects(
            beside,
            heads if imported is None else _not_seen(heads, imported.measured),
            region=region,
            ground_height=ground_height,
            carriageway=carriageway,
            covers=covers,
            lane_decks=deck_area(network),
            deck_height=deck_heights,
            leave_out=("barriers", "furniture") if clutter == "none" else (),
            objects=street_objects(own_objects),
            tell=between(tell, BUILDINGS, 0.95, "furniture"),
        ),
    }
    tell(0.95, "one mesh of all")
    if len(network.levels) > 1:
        objects["deck piers"] = deck_pier_mesh(
            network, surface, region=region, ground_height=ground_height
        )
    if imported is not None:
        objects["imported"] = (imported.mesh, {"triangles": len(imported.mesh.faces)})
        objects["surveyed trees"] = surveyed_tree_mesh(
            imported.trees, ground_height, region=region, carriageway=carriageway
        )
    for name in sorted(objects.keys() - _NOT_CLEARED):
        mesh, counts = objects[name]
        mesh, count = swept.clear(mesh, whole_parts=True)
        objects[name], cleared[name] = (mesh, counts), count
    objects, removed = without_things(objects, corrections)
    added, built = added_things(
        corrections,
        region=region,
        ground_height=ground_height,
        deck_height=deck_heights,
        carriageway=carriageway,
        lane_decks=deck_area(network),
    )
    if len(added.faces):
        objects["corrections"] = added, {"triangles": len(added.faces)}
    meshes, first = [ground, decks], FIRST_OBJECT
    notes: dict[str, object] = {
        "surface": _ground_notes(ground, network),
        "clutter": {"beside the streets": clutter, "assumed": assumed},
        "cleared_from_lanes": {name: n for name, n in sorted(cleared.items()) if n},
    }
    for name, (mesh, counts) in objects.items():
        meshes.append(replace(mesh, part=mesh.part + np.int32(first)))
        first += int(mesh.part.max(initial=0)) + 1
        notes[name] = counts
    # Buildings are the first mesh.
    colours = buildings.colours.moved(FIRST_OBJECT)
    return Scene(LabelledMesh.concatenate(meshes), notes, colours, (*outcomes, *removed, *built))


def _not_seen(heads: Sequence[Head], measured: shapely.Geometry) -> list[Head]:
    """Return the signals and signs outside measured areas, where they are not yet in the scene.

    Their positions are from the lane model; their poles and arms are assumed.
    """
    shapely.prepare(measured)
    return [one for one in heads if not shapely.contains_xy(measured, one.x, one.y)]


def _paved_when_unmapped(measured: shapely.Geometry) -> shapely.Geometry:
    """Return the measured ground assumed to be asphalt without a map: all of it.

    Outlines of cells are simplified, so that borders do not follow every cell.
    """
    return shapely.simplify(shapely.buffer(shapely.buffer(measured, 1.0), -1.5), 0.5)


def _kept_free(network: RoadNetwork) -> shapely.Geometry:
    """Return areas where pedestrians cross and wait, and the overhang area of turning vehicles."""
    turns = network.area_of(("connection",), 0)
    return shapely.union(
        network.area_of(("crossing", "walkingarea"), 0), shapely.buffer(turns, SWING_M)
    )


def _ground_notes(ground: LabelledMesh, network: RoadNetwork) -> dict[str, float]:
    """Return areas in plan, square metres: of the mesh, and of the lane model."""
    corners = ground.triangles()[:, :, :2]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    return {
        **{
            f"{kind}_m2": round(float(area[ground.part == number].sum()), 1)
            for kind, number in PARTS.items()
            if kind != "curb"
        },
        "lane_model_carriageway_m2": round(float(network.carriageway(0).area), 1),
        "lane_model_footway_m2": round(float(network.footway(0).area), 1),
    }
