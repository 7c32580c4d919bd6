"""A twin of Pittsburgh beside what two VLP-32C measured there.

The twin is built from the vector map and the ground heights of an Argoverse 2 log. Both sensors
are recorded at their recorded poses, with the annotated boxes as actors. Points on the road and on
actors are compared with those of the real sweep, and so are those of the real sweep a turn later.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.feather
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from urbantwin.dataset import record
from urbantwin.fidelity import (
    Cloud,
    P95Hausdorff,
    RealSurface,
    divergences,
    histograms_of,
    nearest_distances,
)
from urbantwin.fidelity.frame import Frame
from urbantwin.fidelity.histograms import Histograms
from urbantwin.fidelity.nearest_triangle import NearestTriangle
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import DownwardProbe
from urbantwin.site import load_site
from urbantwin.site.rig import Effects
from urbantwin.twin import Twin, build_twin

from .argoverse_log import ActorBox, Log
from .argoverse_world import World
from .pittsburgh_site import Place, motion_of, write_site

#: A point is one of the road this near to the measured ground, metres up or down.
ROAD_M = 0.3
#: Points so near to a box are not of the road.
BOX_M = 0.3
#: The longest edge of the road's surface in plan: real rings lie up to this far apart nearby.
LONGEST_M = 5.0


@dataclass(frozen=True, eq=False)
class Points:
    """Points (N, 3) in the vehicle frame of a sweep, and intensity (N,), 0 to 255."""

    xyz: NDArray[np.float64]
    intensity: NDArray[np.float64]

    def only(self, chosen: NDArray[np.bool_]) -> Points:
        """Some of them."""
        return Points(self.xyz[chosen], self.intensity[chosen])

    def within(self, reach_m: float) -> Points:
        """Those that are not farther away in plan."""
        return self.only(np.hypot(*self.xyz[:, :2].T) < reach_m)


class RoadSurface:
    """The road as triangles between real points in plan; lone points where they are sparse."""

    def __init__(self, real: NDArray[np.float64]) -> None:
        faces = Delaunay(real[:, :2]).simplices.astype(np.int64)
        edges = real[faces] - real[np.roll(faces, 1, axis=1)]
        faces = faces[(np.linalg.norm(edges, axis=2) < LONGEST_M).all(axis=1)]
        alone = np.setdiff1d(np.arange(len(real)), faces)
        self._nearest = NearestTriangle(real, np.vstack([faces, np.tile(alone[:, None], 3)]))

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances (N,) of points to it."""
        return self._nearest.distances(points)


class Yardstick:
    """Real points of one part, to measure others against."""

    def __init__(self, real: Points, origin: NDArray[np.float64], part: str) -> None:
        self._real, self._origin = real, origin
        self._rebuilt = RealSurface(real.xyz, origin)
        self._road = RoadSurface(real.xyz) if part == "road" else None
        self._histograms = self._histograms_of(real)

    def _histograms_of(self, points: Points) -> Histograms:
        cloud = Cloud(points.xyz, points.intensity)
        return histograms_of(cloud, intensity_scale=255.0, origin=self._origin)

    def measured(self, other: Points) -> dict[str, Any]:
        """P95 Hausdorff, Jensen-Shannon and point-to-mesh of other points."""
        far = P95Hausdorff.of(nearest_distances(self._real.xyz, other.xyz))
        plain = self._rebuilt.distances_of(other.xyz)
        mean, median = plain.mean, plain.median
        if self._road is not None:
            distances = self._road.distances(other.xyz)
            mean, median = float(distances.mean()), float(np.median(distances))
        shares = divergences(self._histograms, self._histograms_of(other))
        return {
            "real_points": len(self._real.xyz),
            "points": len(other.xyz),
            "p95_m": far.both,
            "p95_lacking_m": far.real_to_synthetic,
            "p95_added_m": far.synthetic_to_real,
            "js": shares.pop("mean"),
            **{f"js_{name}": value for name, value in shares.items()},
            "p2m_m": mean,
            "p2m_median_m": median,
            "p2m_of_compare_m": plain.mean,
        }


class Sweep:
    """A real sweep, what counts of it, and what is simulated beside it."""

    def __init__(self, log: Log, sweep: int, twin: Twin) -> None:
        self.log, self.sweep, self.twin = log, sweep, twin
        self.place = Place.of(log, sweep, twin)
        self.boxes = list(log.boxes(sweep))
        self.world = World(log, sweep)
        self._probe = DownwardProbe(self.world.ground)
        down = self.place.site_SE3_vehicle.inverse()
        height = self.place.site_SE3_vehicle.translation[2]

        def plan(xy: NDArray[np.float64]) -> NDArray[np.float64]:
            return down.apply(np.column_stack([xy, np.full(len(xy), height)]))[:, :2]

        region = shapely.transform(twin.region, plan)
        self.area = shapely.intersection(self.place.drivable(), shapely.buffer(region, -1.0))
        shapely.prepare(self.area)
        table = pyarrow.feather.read_table(log.folder / f"sensors/lidar/{sweep}.feather")
        self.real = Points(log.points(sweep), table["intensity"].to_numpy().astype(np.float64))

    def parts(self, points: Points) -> dict[str, NDArray[np.bool_]]:
        """Which points are of the road's surface and of actors, by the map, the raster and boxes.

        The same for real and for simulated points.
        """
        actor, near = np.zeros((2, len(points.xyz)), bool)
        for box in self.boxes:
            actor |= box.holds(points.xyz)
            near |= box.holds(points.xyz, BOX_M)
        above = points.xyz[:, 2] - self._probe.height_below(points.xyz + [0, 0, 5])
        road = shapely.contains_xy(self.area, *points.xyz[:, :2].T) & ~near
        return {"road": road & (np.abs(above) < ROAD_M), "actors": actor}

    def split(self, points: Points) -> dict[str, Points]:
        """Points by part."""
        return {part: points.only(some) for part, some in self.parts(points).items()}

    def recorded(self, twin: Twin, boxes: list[ActorBox], out: Path) -> Frame:
        """What the sensors see in a twin with these actors, vehicle frame."""
        motion = motion_of(self.place, twin, boxes)
        record(twin, motion, self.world.rig(Effects()), out, workers=1, stop_s=0.0)
        return open_recording(out).read(0).moved(self.place.site_SE3_vehicle.inverse())

    def again(self, later: Sweep) -> dict[str, Points]:
        """The next real sweep by part: the road where the vehicle was, actors with their boxes."""
        moved = self.place.site_SE3_vehicle.inverse() @ later.place.site_SE3_vehicle
        road = Points(moved.apply(later.real.xyz), later.real.intensity)
        mine = {box.name: box for box in self.boxes}
        found = []
        for box in later.boxes:
            if box.name in mine:
                inside = later.real.only(box.holds(later.real.xyz))
                carried = (mine[box.name].pose @ box.pose.inverse()).apply(inside.xyz)
                found.append(Points(carried, inside.intensity))
        actors = Points(
            np.concatenate([one.xyz for one in found]),
            np.concatenate([one.intensity for one in found]),
        )
        return {"road": road.only(self.parts(road)["road"]), "actors": actors}


def measure(data: Path, reach_m: float = 25.0, radius_m: float = 35.0) -> dict[str, dict[str, Any]]:
    """Figures of the first sweep by part ("road", "actors") and side ("twin", "real").

    Args:
        data: the log's folder.
        reach_m: points farther away than this in plan are left out.
        radius_m: radius of the twin.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        log = Log(data)
        twin = build_twin(load_site(write_site(log, folder / "site", radius_m)), folder / "twin")
        sweep, later = (Sweep(log, sweep, twin) for sweep in log.sweeps)
        bright = {box.name: box.intensity for box in later.boxes}
        boxes = [replace(box, intensity=bright.get(box.name, np.nan)) for box in sweep.boxes]
        frame = sweep.recorded(twin, boxes, folder / "dataset")
        assert frame.intensity is not None
        sides = {
            "twin": sweep.split(Points(frame.points, 255.0 * frame.intensity)),
            "real": sweep.again(later),
        }
        origin = log.mounts["up_lidar"].translation
        figures = {}
        for part, real in sweep.split(sweep.real).items():
            yardstick = Yardstick(real.within(reach_m), origin, part)
            for side, points in sides.items():
                figures[part, side] = yardstick.measured(points[part].within(reach_m))
    return figures
