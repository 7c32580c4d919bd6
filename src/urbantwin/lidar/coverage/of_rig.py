"""How densely a rig covers the site: points per square metre, by sensor and cell.

Three measures, each as an average over time, in points per second and square metre:

- **ground**: what the ground of the static world itself returns.
- **lying**: what a horizontal diffuse surface would return that lies `LEVEL_M` above the ground:
  a bonnet, a roof, a load.
- **facing**: what a diffuse surface would return that stands there and faces the sensor: a car's
  side, a person. It is the mean over a band of `BAND_M` about `LEVEL_M`, estimated from the length
  of the rays within (the track-length estimator of particle transport: Lux and Koblinger 1991,
  "Monte Carlo Particle Transport Methods", CRC Press), so that it holds for beams that run
  level, too.

A ray counts as often as it returns: by the sensor's own model, with its effects and the rig's
weather. What stands in the static world hides what is behind it, but for glass, which weakens what
comes through one pane; actors are not there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.geometry.rays import Hits, RayScene
from urbantwin.lidar.coverage.cells import Cells, cells_over, is_ground
from urbantwin.lidar.coverage.traverse import BAND_M, STEP_M, traverse
from urbantwin.lidar.outage import dead_beams
from urbantwin.lidar.pattern import beam_directions, pattern_directions
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import MountedSensor, Rig
from urbantwin.progress import Progress, untold
from urbantwin.site.rig import Conditions
from urbantwin.taxonomy import semantic_id

__all__ = ["LAYERS", "REFLECTIVITY", "Coverage", "facing_per_frame", "rig_coverage"]

#: The measures, in the order of files and pictures.
LAYERS = ("ground", "lying", "facing")
#: Diffuse reflectivity of the surfaces that are imagined above the ground: a dark car, clothes.
REFLECTIVITY = 0.1

#: Ground that vehicles drive and stand on.
_STREET = ("road", "parking")
#: Most frames of a pattern that does not repeat with the frame that are looked at.
_MOST_FRAMES = 20


@dataclass(frozen=True, eq=False)
class Coverage:
    """Densities over a part of the site, points per second and square metre.

    Attributes:
        cells: the grid.
        sensors: names of the S sensors.
        rate_hz: frames per second: divide by it for points per frame.
        ground: (S, ny, nx) float32, of the ground.
        lying: (S, ny, nx) float32, of a horizontal surface above the ground.
        facing: (S, ny, nx) float32, of a surface above the ground that faces the sensor.
    """

    cells: Cells
    sensors: tuple[str, ...]
    rate_hz: float
    ground: NDArray[np.float32]
    lying: NDArray[np.float32]
    facing: NDArray[np.float32]

    def per_frame(self, layer: str) -> NDArray[np.float32]:
        """Return the density (ny, nx) of all sensors together, points per frame and m2."""
        each: NDArray[np.float32] = getattr(self, layer)
        return np.asarray(each.sum(axis=0) / np.float32(self.rate_hz))

    def summary(self, region: shapely.Polygon | None = None) -> dict[str, Any]:
        """Return what the streets get, as can stand in JSON.

        Args:
            region: what counts, site frame; the whole grid when not given.

        Returns:
            ``street_m2`` (area of the grid's streets) and, for each layer, ``m2_from_N``: the area
            of streets with at least N points per square metre and frame, ``m2_from_2_sensors``:
            with at least one from each of two sensors or more, and ``most``: the densest cell.
        """
        cells = self.cells
        street = np.isin(cells.semantic, [semantic_id(name) for name in _STREET])
        if region is not None:
            rows, columns = cells.shape
            x = cells.x0 + (np.arange(columns) + 0.5) * cells.size_m
            y = cells.y0 + (np.arange(rows) + 0.5) * cells.size_m
            street &= shapely.contains_xy(region, *np.meshgrid(x, y))
        area = cells.size_m**2
        found: dict[str, Any] = {"street_m2": round(float(street.sum() * area), 1)}
        for layer in LAYERS:
            density = self.per_frame(layer)
            each = getattr(self, layer) / np.float32(self.rate_hz)
            several = (each >= 1.0).sum(axis=0) >= 2
            found[layer] = {
                **{
                    f"m2_from_{least}": round(float((street & (density >= least)).sum() * area), 1)
                    for least in (1, 10, 100)
                },
                "m2_from_2_sensors": round(float((street & several).sum() * area), 1),
                "most": round(float(density.max()), 1),
            }
        return found

    def save(self, path: Path) -> None:
        """Write a ``.npz``; the same coverage gives the same bytes."""
        np.savez_compressed(
            path,
            x0=self.cells.x0,
            y0=self.cells.y0,
            cell_m=self.cells.size_m,
            height_m=self.cells.height_m.astype(np.float32),
            semantic=self.cells.semantic,
            sensors=np.array(self.sensors),
            rate_hz=self.rate_hz,
            **{layer: getattr(self, layer) for layer in LAYERS},
        )


def rig_coverage(
    rig: Rig,
    mesh: LabelledMesh,
    bounds: tuple[float, float, float, float],
    *,
    cell_m: float = 0.5,
    surface: SurfaceMaterials | None = None,
    progress: Progress | None = None,
) -> Coverage:
    """Return how densely a rig covers a part of the site.

    Args:
        rig: the sensors; outages at the start of the motion count, later ones do not.
        mesh: the static world, site frame.
        bounds: west, south, east and north edge of what is looked at, site frame, metres.
        cell_m: side of a cell.
        surface: materials of the ground that are finer than the mesh.
        progress: called with the share that is done and what is being done.

    Raises:
        InputError: the rig rides on an actor, there is no ground, or a cell is too small.
    """
    _check_stands(rig)
    tell = progress or untold
    tell(0.0, "the ground")
    cells = cells_over(mesh, bounds, cell_m)
    area, count = cell_m * cell_m, len(rig.sensors)
    found = np.zeros((len(LAYERS), count, *cells.shape), np.float32)
    for number, mounted in enumerate(rig.sensors):
        tell((number + 0.2) / (count + 0.2), f"sensor {mounted.name}")
        ground, lying, facing = _Looking(mounted, rig.conditions, mesh, surface).layers(cells)
        rate = _turns_per_second(mounted)
        found[0, number] = ground * (rate / area)
        found[1, number] = lying * (rate / area)
        found[2, number] = facing * (rate / (area * BAND_M))
    tell(1.0, "done")
    return Coverage(cells, tuple(one.name for one in rig.sensors), rig.rate_hz, *found)


def facing_per_frame(
    rig: Rig,
    mesh: LabelledMesh,
    bounds: tuple[float, float, float, float],
    *,
    cell_m: float,
    progress: Progress | None = None,
) -> tuple[Cells, NDArray[np.float32]]:
    """Return what ``rig_coverage(...).per_frame("facing")`` does (ny, nx), and its cells.

    It takes half the time: neither panes nor what the ground itself returns are looked at.

    Args:
        rig: as `rig_coverage`.
        mesh: the static world, site frame.
        bounds: as `rig_coverage`.
        cell_m: side of a cell.
        progress: as `rig_coverage`.

    Raises:
        InputError: as `rig_coverage`.
    """
    _check_stands(rig)
    tell = progress or untold
    tell(0.0, "the ground")
    cells = cells_over(mesh, bounds, cell_m)
    found = np.zeros((len(rig.sensors), *cells.shape), np.float32)
    for number, mounted in enumerate(rig.sensors):
        tell((number + 0.2) / (len(rig.sensors) + 0.2), f"sensor {mounted.name}")
        facing = _Looking(mounted, rig.conditions, mesh, None).facing(cells)
        found[number] = facing * (_turns_per_second(mounted) / (cell_m * cell_m * BAND_M))
    tell(1.0, "done")
    return cells, np.asarray(found.sum(axis=0) / np.float32(rig.rate_hz))


def _check_stands(rig: Rig) -> None:
    if any(one.carrier_SE3_sensor is not None for one in rig.sensors):
        raise InputError(
            "the rig rides on an actor and covers no fixed place", expected="a rig that stands"
        )


class _Looking:
    """One sensor as it looks at the static world.

    Args:
        mounted: the sensor.
        conditions: the weather and the light.
        mesh: the static world, site frame.
        surface: materials of the ground that are finer than the mesh.
    """

    def __init__(
        self,
        mounted: MountedSensor,
        conditions: Conditions,
        mesh: LabelledMesh,
        surface: SurfaceMaterials | None,
    ) -> None:
        self._mounted = mounted
        self._surface = surface
        self._origin = mounted.site_SE3_sensor.translation
        self._model = ReturnModel(mounted, conditions)
        clear = self._model.scatter.through[mesh.material] > 0
        self._solid, self._panes = mesh.select(~clear), mesh.select(clear)
        # What a metre of a ray is worth at a range: the chance of a return from a facing surface.
        farthest = mounted.sensor.assumed_range_max_m
        ranges = (np.arange(int(np.ceil(farthest / STEP_M))) + 0.5) * STEP_M
        self._weight = self._model.detection(
            np.full(len(ranges), REFLECTIVITY, np.float32), ranges.astype(np.float32)
        )

    @cached_property
    def _normals(self) -> NDArray[np.float64]:
        return self._solid.normals()

    @cached_property
    def _pane_normals(self) -> NDArray[np.float64]:
        return self._panes.normals()

    def _caster(self, part: LabelledMesh) -> RayScene:
        # Moved to the sensor before it becomes float32, so that the error does not grow with the
        # distance from the anchor.
        return RayScene(part.vertices - self._origin, part.faces)

    def _looks(self) -> Iterator[NDArray[np.float64]]:
        """Yield the beams (N, 3) of every turn that differs, site frame."""
        for beams in _turns(self._mounted):
            yield beams @ self._mounted.site_SE3_sensor.rotation.T

    def facing(self, cells: Cells) -> NDArray[np.float64]:
        """Return points per turn, cell and metre of a surface that faces the sensor (ny, nx)."""
        solid, total, turns = self._caster(self._solid), np.zeros(cells.shape), 0
        for aims in self._looks():
            reach_m = solid.cast(np.zeros(3), aims.astype(np.float32)).range_m
            total += traverse(cells, self._origin, aims, reach_m, self._weight).length_m
            turns += 1
        return total / turns

    def layers(self, cells: Cells) -> list[NDArray[np.float64]]:
        """Return points per turn and cell, in the order of `LAYERS`; of facing, per metre."""
        ground, lying, facing = (np.zeros(cells.shape) for _ in LAYERS)
        walkable, turns = is_ground(self._solid, self._normals), 0
        casters = [self._caster(part) for part in (self._solid, self._panes)]
        for aims in self._looks():
            found, pane = (caster.cast(np.zeros(3), aims.astype(np.float32)) for caster in casters)
            passes = self._passes(aims, pane)
            hit = np.flatnonzero(found.face >= 0)
            hit = hit[walkable[found.face[hit]]]
            behind = np.where(pane.range_m[hit] < found.range_m[hit], passes[hit], 1.0)
            place, sent, peak = self._returned(aims[hit], found.face[hit], found.range_m[hit])
            chance = self._chance(sent * behind, found.range_m[hit], peak)
            _add(ground, cells.numbers(place), chance)

            passage = traverse(cells, self._origin, aims, found.range_m, self._weight)
            ray = np.flatnonzero(passage.cell >= 0)
            behind = np.where(pane.range_m[ray] < passage.range_m[ray], passes[ray], 1.0)
            sent = REFLECTIVITY * np.abs(aims[ray, 2]) * behind
            away = passage.range_m[ray].astype(np.float32)
            _add(lying, passage.cell[ray], self._model.detection(sent.astype(np.float32), away))
            facing += passage.length_m
            turns += 1
        return [layer / turns for layer in (ground, lying, facing)]

    def _passes(self, aims: NDArray[np.float64], pane: Hits) -> NDArray[np.float64]:
        """Return the share (N,) of rays (N, 3) that passes the first pane of glass to and fro."""
        passes = np.ones(len(aims))
        hit = np.flatnonzero(pane.face >= 0)
        face = pane.face[hit]
        cosine = np.abs((self._pane_normals[face] * aims[hit]).sum(axis=1))
        passes[hit] = self._model.scatter.transmission(self._panes.material[face], cosine)
        return passes

    def _returned(
        self, aims: NDArray[np.float64], face: NDArray[np.int32], range_m: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float32]]:
        """Return where rays (N, 3) meet faces (N,), (N, 3), what these send back, its peak (N,)."""
        place = self._origin + aims * range_m[:, None]
        material = self._solid.material[face]
        if self._surface is not None:
            material = self._surface.materials_of(self._solid, face, place)
        cosine = np.abs((self._normals[face] * aims).sum(axis=1)).astype(np.float32)
        peak = self._model.peak_left(range_m, cosine)
        return place, self._model.scatter.backscatter(material, cosine), peak

    def _chance(
        self,
        amplitude: NDArray[np.floating],
        range_m: NDArray[np.float32],
        peak: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """Return the chance (N,) of a return from ground, over all that its texture may be."""
        scatter = self._model.scatter
        median = np.asarray(amplitude * np.exp(-(scatter.texture**2) / 2), np.float32)
        return self._model.detection_among(median, range_m, scatter.ground_spread, peak)


def _turns(mounted: MountedSensor) -> Iterator[NDArray[np.float64]]:
    """Yield the beams (N, 3) that work of every turn that differs, sensor frame."""
    pattern, count = mounted.sensor.pattern, 1
    if pattern is not None:
        count = int(np.clip(np.ceil(pattern.period_s * mounted.rate_hz), 1, _MOST_FRAMES))
    for frame in range(count):
        if pattern is None:
            beams = beam_directions(mounted.sensor, mounted.columns)
        else:
            beams = pattern_directions(pattern, mounted.columns, frame, mounted.rate_hz)
        dead = dead_beams(mounted, frame / mounted.rate_hz)
        yield beams.reshape(-1, 3) if dead is None else beams[~dead]


def _turns_per_second(mounted: MountedSensor) -> float:
    """Return how many turns a second are recorded, on average, as far as beams return any."""
    recorded = min(1.0, mounted.frame_window_s * mounted.rate_hz)
    working = (1.0 - mounted.dropped_frames) * (1.0 - mounted.missing)
    return mounted.turns_per_second * recorded * working


def _add(layer: NDArray[np.float64], cell: NDArray[np.int64], chance: NDArray[np.float64]) -> None:
    """Add chances (N,) to the cells (N,) of a layer; those in no cell are left out."""
    inside = cell >= 0
    layer += np.bincount(cell[inside], chance[inside], layer.size).reshape(layer.shape)
