"""The real case from end to end: a twin of Pittsburgh beside what two VLP-32C really saw there.

The twin is built from the vector map and the ground's heights of an Argoverse 2 log, both sensors
are recorded where they were, with the annotated boxes as actors, and what they saw of the road's
surface and of actors is measured against the real sweep: beside it the real sweep a turn later,
and the same sensors on a car at an arbitrary site.

    python benchmarks/pittsburgh.py
    python benchmarks/pittsburgh.py --picture pittsburgh.png --json
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.feather
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from argoverse_log import DATA, ActorBox, Log
from argoverse_world import World
from pittsburgh_actors import SweepRays, mended
from pittsburgh_background import GEOMETRY, write_background
from pittsburgh_twin import RADIUS_M, Place, elsewhere, motion_of, write_site
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

#: A point is one of the road this near to the measured ground, metres up or down.
ROAD_M = 0.3
#: Points so near to a box are not of the road.
BOX_M = 0.3
#: The longest edge of the road's surface in plan: real rings lie up to this far apart nearby.
LONGEST_M = 5.0
#: Parts are measured up to these distances in plan.
REACHES_M = (25.0, 40.0, 100.0)
PUBLISHED = {"p95_m": 70.2, "js": 63.7, "p2m_m": 69.9}
TARGETS = {"p95_m": 1.0, "js": 0.15, "p2m_m": 0.10}
MEANS = (*TARGETS, "p95_lacking_m", "p95_added_m", "p2m_median_m")
ELSEWHERE = "arbitrary"


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

    def standing(self, gone: set[str]) -> NDArray[np.bool_]:
        """Which real points are of what is in no map: not of the road, and in no box.

        Args:
            gone: names of boxes that hold nothing of their class.
        """
        found = ~self.parts(self.real)["road"]
        for box in self.boxes:
            if box.name not in gone:
                found &= ~box.holds(self.real.xyz, BOX_M)
        return found

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


def measure(
    data: Path = DATA,
    scratch: Path | None = None,
    keep: list[Any] | None = None,
    *,
    whole: bool = True,
    radius_m: float = RADIUS_M,
) -> dict[str, Any]:
    """Everything, of both sweeps; what the picture shows goes to ``keep``.

    Args:
        data: the log's folder.
        scratch: where twins and datasets stay; nowhere if not given.
        keep: takes each sweep with its frames and their points by part.
        whole: without it, only the first sweep is measured, only the nearest reach, and beside
            no arbitrary site.
        radius_m: of the twin.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = scratch or Path(temporary)
        log = Log(data)
        twin = build_twin(load_site(write_site(log, folder / "site", radius_m)), folder / "twin")
        sweeps = [Sweep(log, sweep, twin) for sweep in log.sweeps]
        others = elsewhere(sweeps[0].world.rig(Effects()), folder / "elsewhere") if whole else []
        rows, reaches = [], REACHES_M if whole else REACHES_M[:1]
        for number, sweep in enumerate(sweeps if whole else sweeps[:1]):
            frames = _recorded(
                sweep, sweeps[1 - number], folder / f"{number}", radius_m, reaches[-1]
            )
            seen = {side: sweep.split(_points_of(frame)) for side, frame in frames.items()}
            seen["real"] = sweep.again(sweeps[1 - number])
            for index, other in enumerate(others):
                points = Points(other.xyz, other.intensity)
                seen[f"{ELSEWHERE} {index}"] = {
                    "road": points.only(other.road), "actors": points.only(other.actors)
                }  # fmt: skip
            if keep is not None:
                keep.append((sweep, frames, seen))
            origin = log.mounts["up_lidar"].translation
            for part, real in sweep.split(sweep.real).items():
                for reach in reaches:
                    yardstick = Yardstick(real.within(reach), origin, part)
                    rows += [
                        {
                            "sweep": number, "part": part, "reach_m": reach, "side": side,
                            **yardstick.measured(points[part].within(reach)),
                        }
                        for side, points in seen.items()
                    ]  # fmt: skip
    return {"rows": rows, "means": means(rows)}


def _points_of(frame: Frame) -> Points:
    assert frame.intensity is not None
    return Points(frame.points, 255.0 * frame.intensity)


def _recorded(
    sweep: Sweep, other: Sweep, folder: Path, radius_m: float, reach_m: float
) -> dict[str, Frame]:
    """A sweep's frames in its twin: as the map has it, and with what the other sweep measured.

    Actors farther away than ``reach_m`` are not fitted.
    """
    log = sweep.log
    bright = {box.name: box.intensity for box in other.boxes}
    boxes = [replace(box, intensity=bright.get(box.name, np.nan)) for box in sweep.boxes]
    rays = SweepRays.of(log, other.sweep)
    fits = [
        mended(box, other.boxes, rays) if np.hypot(*box.pose.translation[:2]) < reach_m else box
        for box in boxes
    ]
    gone = {box.name for box, fit in zip(boxes, fits, strict=True) if fit is None}
    path = write_site(log, folder / "site", radius_m, GEOMETRY)
    write_background(
        log, other.sweep, other.standing(gone), other.place.site_SE3_vehicle,
        path.with_name(GEOMETRY["file"]),
    )  # fmt: skip
    background = build_twin(load_site(path), folder / "twin")
    return {
        "twin": sweep.recorded(sweep.twin, boxes, folder / "plain"),
        "with background": sweep.recorded(background, boxes, folder / "background"),
        "and actors fitted": sweep.recorded(
            background, [fit for fit in fits if fit is not None], folder / "fitted"
        ),
    }


def means(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means of both sweeps; reductions against the arbitrary site, ratios to real against real.

    Of the moments at the arbitrary site, each measure takes the one that is nearest to the real
    frames.
    """
    table: dict[tuple[str, float, str], dict[str, float]] = {}
    for key in dict.fromkeys((row["part"], row["reach_m"], row["side"]) for row in rows):
        mine = [row for row in rows if (row["part"], row["reach_m"], row["side"]) == key]
        figures = {name: float(np.mean([row[name] for row in mine])) for name in MEANS}
        part, reach, side = key
        if side.startswith(ELSEWHERE):
            side = ELSEWHERE
            best = table.get((part, reach, side), figures)
            figures = {name: min(value, best[name]) for name, value in figures.items()}
        table[part, reach, side] = figures
    found = []
    for (part, reach, side), figures in table.items():
        row: dict[str, Any] = {"part": part, "reach_m": reach, "side": side}
        row |= {name: round(value, 3) for name, value in figures.items()}
        if side not in (ELSEWHERE, "real"):
            control = table.get((part, reach, ELSEWHERE))
            for name in TARGETS:
                if control:
                    row[f"less_{name}"] = round(100 * (1 - figures[name] / control[name]), 1)
                row[f"ratio_{name}"] = round(figures[name] / table[part, reach, "real"][name], 1)
        found.append(row)
    return found


def draw(seen: list[Any], path: Path) -> None:
    """Write a picture: real and simulated points of the road and of actors in plan."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot
    from shapely.plotting import plot_polygon

    sweep, frames, sides = seen[0]
    shown = {"real": (sweep.real, sweep.split(sweep.real))}
    shown |= {side: (_points_of(frame), sides[side]) for side, frame in frames.items()}
    figure, rows = pyplot.subplots(2, len(shown), figsize=(8 * len(shown), 16), squeeze=False)
    for k, (name, (everything, parts)) in enumerate(shown.items()):
        for axes, reach in zip(rows[:, k], (100, 30), strict=True):
            plot_polygon(sweep.area, ax=axes, add_points=False, color="0.9")
            axes.scatter(*everything.xyz[:, :2].T, s=0.3, color="0.55", label="all else")
            axes.scatter(*parts["road"].xyz[:, :2].T, s=1, color="C0", label="road")
            axes.scatter(*parts["actors"].xyz[:, :2].T, s=1, color="C3", label="actors")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=name)
    rows[0, 0].legend(markerscale=6)
    figure.tight_layout()
    figure.savefig(path, dpi=60)
    pyplot.close(figure)


def table(rows: list[dict[str, Any]]) -> str:
    """Rows under their keys."""
    keys = list(max(rows, key=len))
    lines = [[str(row.get(key, "")) for key in keys] for row in rows]
    width = [max(len(line[k]) for line in [keys, *lines]) for k in range(len(keys))]
    return "\n".join(
        "  ".join(text.rjust(w) for text, w in zip(line, width, strict=True))
        for line in [keys, *lines]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--scratch", type=Path, help="where twins and datasets stay")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise SystemExit(f"{options.data} is missing")
    seen: list[Any] = []
    result = measure(options.data, options.scratch, seen)
    if options.picture:
        draw(seen, options.picture)
    if options.json:
        print(json.dumps(result, indent=1))
        return
    print(table(result["means"]))
    print(f"\ntargets: {TARGETS}; less than the arbitrary site by more than {PUBLISHED} percent")


if __name__ == "__main__":
    main()
