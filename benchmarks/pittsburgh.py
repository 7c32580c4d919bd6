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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.feather
import shapely
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from argoverse_log import DATA, SENSORS, ActorBox, Log
from argoverse_world import World, numbers_of
from pittsburgh_twin import RADIUS_M, Place, elsewhere, fitted, motion_of, write_site
from urbantwin.dataset import record
from urbantwin.fidelity import Cloud, RealSurface, divergences, histograms_of, p95_hausdorff
from urbantwin.fidelity.closest import NearestTriangle
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import DownwardProbe
from urbantwin.site import load_site
from urbantwin.site.rig import Effects
from urbantwin.twin import Twin, build_twin

#: A point is one of the road this near to the measured ground, metres up or down.
ROAD_M = 0.3
#: Points so near to a box are not of the road.
BOX_M = 0.3
#: A simulated point whose real ray ended this much sooner, outside of boxes, is hidden.
HIDDEN_M = 1.0
#: The longest edge of the road's surface in plan: real rings lie up to this far apart nearby.
LONGEST_M = 5.0
#: Parts are measured up to these distances in plan.
REACHES_M = (25.0, 40.0, 100.0)
PUBLISHED = {"p95_m": 70.2, "js": 63.7, "p2m_m": 69.9}
TARGETS = {"p95_m": 1.0, "js": 0.15, "p2m_m": 0.10}


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


def measured(real: Points, other: Points, origin: NDArray[np.float64], part: str) -> dict[str, Any]:
    """P95 Hausdorff, Jensen-Shannon and point-to-mesh of points against the real ones."""
    far = p95_hausdorff(real.xyz, other.xyz)
    rebuilt = RealSurface(real.xyz, origin)
    plain = rebuilt.distances_of(other.xyz)
    mean, median = plain.mean, plain.median
    if part == "road":
        distances = RoadSurface(real.xyz).distances(other.xyz)
        mean, median = float(distances.mean()), float(np.median(distances))
    histograms = [
        histograms_of(Cloud(one.xyz, one.intensity), intensity_scale=255.0, origin=origin)
        for one in (real, other)
    ]
    shares = divergences(*histograms)
    return {
        "real_points": len(real.xyz),
        "points": len(other.xyz),
        "p95_m": far.both,
        "p95_lacking_m": far.real_to_synthetic,
        "p95_added_m": far.synthetic_to_real,
        "js": shares.pop("mean"),
        **{f"js_{name}": value for name, value in shares.items()},
        "p2m_m": mean,
        "p2m_median_m": median,
        "p2m_of_compare_m": plain.mean,
        "rebuild_error_m": rebuilt.rebuild_error.mean if rebuilt.rebuild_error else None,
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

    def recorded(self, boxes: list[ActorBox], out: Path) -> tuple[Points, NDArray[np.bool_]]:
        """What the sensors see in the twin, and what of it is hidden by what is in no map."""
        motion = motion_of(self.place, self.twin, boxes)
        rig = self.world.rig(Effects())
        record(self.twin, motion, rig, out, workers=1, stop_s=0.0)
        frame = open_recording(out).read(0)
        assert frame.intensity is not None
        xyz = self.place.site_SE3_vehicle.inverse().apply(frame.points)
        hidden = np.zeros(len(xyz), bool)
        for number, (name, _, _) in enumerate(SENSORS):
            real = self.log.rays(self.sweep, name)
            point = numbers_of(frame.sensor, frame.ring, frame.column)[number][:, real.column]
            range_m = np.linalg.norm(xyz - self.log.mounts[name].translation, axis=1)
            places = real.points_m.reshape(-1, 3)
            back = np.isfinite(places[:, 0])
            boxed = np.zeros(len(places), bool)
            for box in self.boxes:
                boxed[back] |= box.holds(places[back], BOX_M)
            sooner = (real.range_m < range_m[point] - HIDDEN_M) & ~boxed.reshape(point.shape)
            hidden[point[(point >= 0) & sooner]] = True
        return Points(xyz, 255.0 * frame.intensity), hidden

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
        keep: takes each sweep with its points.
        whole: without it, only the twin is recorded, for the first sweep, and only the
            nearest reach is measured.
        radius_m: of the twin.
    """
    with tempfile.TemporaryDirectory() as temporary:
        folder = scratch or Path(temporary)
        log = Log(data)
        twin = build_twin(load_site(write_site(log, folder / "site", radius_m)), folder / "twin")
        sweeps = [Sweep(log, sweep, twin) for sweep in log.sweeps]
        other = None
        if whole:
            other = elsewhere(sweeps[0].world.rig(Effects()), folder / "elsewhere")
        rows = []
        for number, sweep in enumerate(sweeps if whole else sweeps[:1]):
            seen = _seen(sweep, sweeps[1 - number], folder / f"{number}", whole=whole)
            if other is not None:
                points = Points(other.xyz, other.intensity)
                seen["arbitrary"] = {
                    "road": points.only(other.road), "actors": points.only(other.actors)
                }  # fmt: skip
            if keep is not None:
                keep.append((sweep, seen))
            origin = log.mounts["up_lidar"].translation
            real = {part: sweep.real.only(some) for part, some in sweep.parts(sweep.real).items()}
            for part in ("road", "actors"):
                for reach in REACHES_M if whole else REACHES_M[:1]:
                    rows += [
                        {
                            "sweep": number, "part": part, "reach_m": reach, "side": side,
                            **measured(
                                real[part].within(reach), points[part].within(reach), origin, part
                            ),
                        }
                        for side, points in seen.items()
                        if part in points
                    ]  # fmt: skip
    return {"rows": rows, "means": means(rows)}


def _seen(sweep: Sweep, later: Sweep, out: Path, *, whole: bool) -> dict[str, dict[str, Points]]:
    """The points of each side by part."""
    points, hidden = sweep.recorded(sweep.boxes, out.with_suffix(".boxes"))
    parts = sweep.parts(points)
    found = {
        "twin": {part: points.only(some) for part, some in parts.items()},
        "twin, not hidden": {part: points.only(some & ~hidden) for part, some in parts.items()},
        "real": sweep.again(later),
    }
    if not whole:
        return found
    fits = [fitted(box, later.boxes, later.real.xyz, sweep.log) for box in sweep.boxes]
    closer, closer_hidden = sweep.recorded(fits, out.with_suffix(".fitted"))
    inside = sweep.parts(closer)["actors"]
    found["twin, fitted"] = {"actors": closer.only(inside)}
    found["twin, fitted, not hidden"] = {"actors": closer.only(inside & ~closer_hidden)}
    return found


def means(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Means of both sweeps; reductions against the arbitrary site, ratios to real against real."""
    keys = [(row["part"], row["reach_m"], row["side"]) for row in rows]
    table: dict[tuple[str, float, str], dict[str, Any]] = {}
    for key in dict.fromkeys(keys):
        mine = [row for row, its in zip(rows, keys, strict=True) if its == key]
        table[key] = {
            name: float(np.mean([row[name] for row in mine])) for name in (*TARGETS, "p2m_median_m")
        }
    found = []
    for (part, reach, side), figures in table.items():
        row: dict[str, Any] = {"part": part, "reach_m": reach, "side": side}
        row |= {name: round(value, 3) for name, value in figures.items()}
        for name in TARGETS:
            value = figures[name]
            if (part, reach, "arbitrary") in table and side not in ("arbitrary", "real"):
                control = table[part, reach, "arbitrary"][name]
                row[f"less_{name}"] = round(100 * (1 - value / control), 1)
            if side not in ("arbitrary", "real"):
                row[f"ratio_{name}"] = round(value / table[part, reach, "real"][name], 1)
        found.append(row)
    return found


def draw(seen: list[Any], path: Path) -> None:
    """Write a picture: real and simulated points of the road and of actors in plan."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot
    from shapely.plotting import plot_polygon

    sweep, sides = seen[0]
    parts = sweep.parts(sweep.real)
    real = {part: sweep.real.only(some) for part, some in parts.items()}
    shown = {"real": real, "twin": sides["twin"]}
    if "arbitrary" in sides:
        shown["arbitrary site"] = sides["arbitrary"]
    figure, rows = pyplot.subplots(2, len(shown), figsize=(8 * len(shown), 14), squeeze=False)
    for k, (name, points) in enumerate(shown.items()):
        for axes, reach in zip(rows[:, k], (100, 30), strict=True):
            if name != "arbitrary site":
                plot_polygon(sweep.area, ax=axes, add_points=False, color="0.85")
            axes.scatter(*points["road"].xyz[:, :2].T, s=1, color="C0", label="road")
            axes.scatter(*points["actors"].xyz[:, :2].T, s=1, color="C3", label="actors")
            if name == "twin":
                kept = {tuple(one) for one in sides["twin, not hidden"]["road"].xyz}
                lost = np.array([one for one in points["road"].xyz if tuple(one) not in kept])
                if len(lost):
                    axes.scatter(*lost[:, :2].T, s=2, color="C1", label="road, really hidden")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", title=name)
    rows[0, 1].legend(markerscale=6)
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])  # type: ignore[union-attr]
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
