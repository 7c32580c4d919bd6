"""Coverage: point density of a rig over the site, per sensor and cell.

Three densities, averaged over time, in points per second and square metre:

- **ground**: returns of the ground of the static world.
- **lying**: returns of a horizontal diffuse surface `LEVEL_M` above the ground: a bonnet, a roof, a
  load.
- **facing**: returns of a diffuse surface there that faces the sensor: a car's side, a person. It
  is the mean over a band of `BAND_M` about `LEVEL_M`, estimated from the path length of the rays
  within (the track-length estimator of particle transport: Lux and Koblinger 1991, "Monte Carlo
  Particle Transport Methods", CRC Press), so that it holds for horizontal beams too.

Ground returns are those of `expected_points`. The two surfaces are hypothetical; beams pass panes
of glass on the way, and the first pane attenuates the return of a lying one. A ray counts with its
probability of a return by the sensor's model, with effects and weather. There are no actors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.geometry import LabelledMesh, SurfaceMaterials
from urbantwin.geometry.rays import RayScene
from urbantwin.lidar.beams import Beams
from urbantwin.lidar.returns import ReturnModel
from urbantwin.lidar.rig import MountedSensor, Rig
from urbantwin.lidar.sight.cells import BAND_M, STEP_M, Cells, Passage, cells_over, traverse
from urbantwin.lidar.sight.expected_points import ExpectedPoints, one_pose
from urbantwin.lidar.sight.field_of_view import turns_of
from urbantwin.progress import Progress, untold
from urbantwin.site.rig import Conditions
from urbantwin.taxonomy import semantic_id

__all__ = ["LAYERS", "REFLECTIVITY", "Coverage", "facing_per_frame", "rig_coverage"]

#: Densities, in the order of files and pictures.
LAYERS = ("ground", "lying", "facing")
#: Diffuse reflectivity of the hypothetical surfaces: a dark car, clothes.
REFLECTIVITY = 0.1

#: Ground that vehicles drive and stand on.
_STREET = ("road", "parking")


@dataclass(frozen=True, eq=False)
class Coverage:
    """Densities over a part of the site, points per second and square metre.

    Attributes:
        cells: the grid.
        sensors: names of the S sensors.
        rate_hz: frames per second: divide by it for points per frame.
        ground: (S, ny, nx) float32, ground.
        lying: (S, ny, nx) float32, horizontal surface above the ground.
        facing: (S, ny, nx) float32, surface above the ground that faces the sensor.
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
        """Return statistics over streets, for JSON.

        Args:
            region: area that counts, site frame; the whole grid if not given.

        Returns:
            ``street_m2`` (area of the grid's streets) and, for each density, ``m2_from_N``: area of
            streets with at least N points per square metre and frame, ``m2_from_2_sensors``: with
            at least one from each of two sensors, and ``most``: the densest cell.
        """
        cells = self.cells
        street = np.isin(cells.semantic, [semantic_id(name) for name in _STREET])
        if region is not None:
            rows, columns = cells.shape
            x = cells.x0 + (np.arange(columns) + 0.5) * cells.size_m
            y = cells.y0 + (np.arange(rows) + 0.5) * cells.size_m
            street &= shapely.contains_xy(region, *np.meshgrid(x, y))
        area = cells.size_m**2
        summary: dict[str, Any] = {"street_m2": round(float(street.sum() * area), 1)}
        for layer in LAYERS:
            density = self.per_frame(layer)
            each = getattr(self, layer) / np.float32(self.rate_hz)
            several = (each >= 1.0).sum(axis=0) >= 2
            summary[layer] = {
                **{
                    f"m2_from_{least}": round(float((street & (density >= least)).sum() * area), 1)
                    for least in (1, 10, 100)
                },
                "m2_from_2_sensors": round(float((street & several).sum() * area), 1),
                "most": round(float(density.max()), 1),
            }
        return summary

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
    """Return the coverage of a part of the site by a rig.

    Args:
        rig: the sensors; outages at the start of the motion count, later ones do not.
        mesh: the static world, site frame.
        bounds: west, south, east and north edge of the part, site frame, metres.
        cell_m: side of a cell.
        surface: materials of the ground at finer resolution than the mesh.
        progress: called with the fraction done and a description.

    Raises:
        InputError: the rig is mounted on an actor, there is no ground, or a cell is too small.
    """
    _check_stands(rig)
    tell = progress or untold
    tell(0.0, "the ground")
    cells = cells_over(mesh, bounds, cell_m)
    area, count = cell_m * cell_m, len(rig.sensors)
    density = np.zeros((len(LAYERS), count, *cells.shape), np.float32)
    centre = np.mean(
        [mounted_sensor.site_SE3_sensor.translation for mounted_sensor in rig.sensors], axis=0
    )
    world = ExpectedPoints(mesh, surface, centre)
    for number, mounted in enumerate(rig.sensors):
        tell((number + 0.2) / (count + 0.2), f"sensor {mounted.name}")
        layers = _Air(mounted, rig.conditions, mesh).layers(cells, world)
        density[:, number] = np.stack(layers) * (_turns_per_second(mounted) / area)
    density[2] /= BAND_M
    tell(1.0, "done")
    return Coverage(
        cells, tuple(mounted_sensor.name for mounted_sensor in rig.sensors), rig.rate_hz, *density
    )


def facing_per_frame(
    rig: Rig,
    mesh: LabelledMesh,
    bounds: tuple[float, float, float, float],
    *,
    cell_m: float,
    progress: Progress | None = None,
) -> tuple[Cells, NDArray[np.float32]]:
    """Return ``rig_coverage(...).per_frame("facing")`` (ny, nx), and its cells.

    Much faster: panes and returns of the ground are left out.

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
    density = np.zeros((len(rig.sensors), *cells.shape), np.float32)
    for number, mounted in enumerate(rig.sensors):
        tell((number + 0.2) / (len(rig.sensors) + 0.2), f"sensor {mounted.name}")
        facing = _Air(mounted, rig.conditions, mesh).facing(cells)
        density[number] = facing * (_turns_per_second(mounted) / (cell_m * cell_m * BAND_M))
    tell(1.0, "done")
    return cells, np.asarray(density.sum(axis=0) / np.float32(rig.rate_hz))


def _check_stands(rig: Rig) -> None:
    if any(one.carrier_SE3_sensor is not None for one in rig.sensors):
        raise InputError(
            "the rig is mounted on a vehicle and covers no fixed place", expected="a static rig"
        )


class _Air:
    """Hypothetical surfaces above the ground, in sight of one sensor.

    Args:
        mounted: the sensor.
        conditions: the weather and the light.
        mesh: the static world, site frame.
    """

    def __init__(self, mounted: MountedSensor, conditions: Conditions, mesh: LabelledMesh) -> None:
        self._mounted = mounted
        self._pose = mounted.site_SE3_sensor
        self._model = ReturnModel(mounted, conditions)
        solid = mesh.select(self._model.scatter.through[mesh.material] == 0)
        # Relative to the sensor, because rays are float32.
        self._solid = RayScene(solid.vertices - self._pose.translation, solid.faces)
        # Weight of a metre of a ray by range: the probability of a return from a facing surface.
        farthest = mounted.sensor.assumed_range_max_m
        ranges = (np.arange(int(np.ceil(farthest / STEP_M))) + 0.5) * STEP_M
        self._weight = self._chance(REFLECTIVITY, ranges)

    def _chance(
        self, amplitude: NDArray[np.floating] | float, range_m: NDArray[np.floating]
    ) -> NDArray[np.float64]:
        """Return the probability (N,) of a return of an amplitude (N,)."""
        sent = np.full(range_m.shape, amplitude, np.float32)
        return self._model.detection(sent, range_m.astype(np.float32))

    def _passage(self, cells: Cells, beams: NDArray[np.float64]) -> Passage:
        """Follow beams (N, 3), sensor frame, until they hit something opaque."""
        aims = beams @ self._pose.rotation.T
        reach_m = self._solid.cast(np.zeros(3), aims.astype(np.float32)).range_m
        return traverse(cells, self._pose.translation, aims, reach_m, self._weight)

    def facing(self, cells: Cells) -> NDArray[np.float64]:
        """Return points per turn, cell and metre of a surface that faces the sensor (ny, nx)."""
        each = [
            self._passage(cells, beams[works]).length_m
            for _, beams, works in turns_of(self._mounted)
        ]
        return np.asarray(sum(each) / len(each))

    def layers(self, cells: Cells, world: ExpectedPoints) -> list[NDArray[np.float64]]:
        """Return points per turn and cell, in the order of `LAYERS`; for facing, per metre."""
        ground, lying, facing = (np.zeros(cells.shape) for _ in LAYERS)
        turns = list(turns_of(self._mounted))
        for number, beams, works in turns:
            turn = world.turn(
                self._mounted, self._model, Beams.of(self._mounted, number), one_pose(self._pose)
            )
            points = turn.points
            hit = np.flatnonzero(points.is_ground & works[points.beam])
            _add(ground, cells.numbers(points.place[hit]), points.chance[hit])

            passage = self._passage(cells, beams[works])
            ray = np.flatnonzero(passage.cell >= 0)
            beam, range_m = np.flatnonzero(works)[ray], passage.range_m[ray]
            pane_m, passes = turn.panes()
            sent = REFLECTIVITY * np.abs(turn.aims[beam, 2])
            sent = np.where(pane_m[beam] < range_m, passes[beam], 1.0) * sent
            _add(lying, passage.cell[ray], self._chance(sent, range_m))
            facing += passage.length_m
        return [layer / len(turns) for layer in (ground, lying, facing)]


def _turns_per_second(mounted: MountedSensor) -> float:
    """Return the mean number of recorded turns per second, times the share of working beams."""
    recorded = min(1.0, mounted.frame_window_s * mounted.rate_hz)
    working = (1.0 - mounted.dropped_frames) * (1.0 - mounted.missing)
    return mounted.turns_per_second * recorded * working


def _add(layer: NDArray[np.float64], cell: NDArray[np.int64], chance: NDArray[np.float64]) -> None:
    """Add probabilities (N,) to the cells (N,) of a layer; -1 is outside."""
    inside = cell >= 0
    layer += np.bincount(cell[inside], chance[inside], layer.size).reshape(layer.shape)
