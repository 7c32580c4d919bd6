"""How near a twin built from a recording is to the place (notebook/hannover.md).

    python benchmarks/recorded_world.py picture REAL DATASET sides.png
    python benchmarks/recorded_world.py realism REAL DATASET [DATASET ...]
    python benchmarks/recorded_world.py windows REAL ANCHOR DATASET [DATASET ...]
    python benchmarks/recorded_world.py judge DATASET REBUILT_DATASET TWIN REBUILT_TWIN RINGS
    python benchmarks/recorded_world.py spacing OBSERVED MOTION

`picture` draws the middle frame of each from above, side by side. `realism` is that of the
challenge's protocol of all frames of each against all real ones, by ten draws of points in place of
one. `windows` holds several datasets, as of several times of one drive, against the same real
frames, and says by how much one such draw of traffic scatters: background and objects, beside those
of other real frames. These three crop to the protocol's 40 x 40 x 5 m. `judge` compares what one
rig records in a true twin and in one that was rebuilt from another rig's recording of it, beam by
beam, and the heights of their ground. `spacing` tells how far apart frames may be: which share of
an observation's vehicles stands in the same place one frame later, two, and so on, and the same of
moments of a motion so many seconds apart.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

import urbantwin as ut
from urbantwin.fidelity.challenge import cropped, normalised
from urbantwin.fidelity.challenge.realism import EMD_POINTS, POINTS, SEED
from urbantwin.fidelity.chamfer import chamfer_squared
from urbantwin.fidelity.earth_mover import earth_mover
from urbantwin.fidelity.foreground_objects import ground_beneath, object_divergences, objects_of
from urbantwin.fidelity.frechet import frechet_places
from urbantwin.fidelity.hausdorff import P95Hausdorff
from urbantwin.fidelity.histograms import divergences, histograms_of
from urbantwin.fidelity.mean_discrepancy import mean_discrepancy
from urbantwin.fidelity.nearest_point import NearestDistances, nearest_distances
from urbantwin.fidelity.point_to_mesh import RealSurface
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.readers.recording import cropped_recording
from urbantwin.fidelity.sampling import sampled
from urbantwin.fidelity.sides import MODEL, Side, model_background
from urbantwin.geometry import DownwardProbe
from urbantwin.reconstruct.recording.recorded_world import read_recording
from urbantwin.taxonomy import semantic_classes

REACH_M = 45.0
HALF_M, STEP_M = 35.0, 0.5
DRAWS = 10
CROP_M = (40.0, 40.0, 5.0)
SAME_M, NOBODY = 0.4, np.zeros((0, 2))


def picture(real, dataset, out):
    """Draw a real and a synthetic frame from above, colours by height."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(16, 8), facecolor="black")
    for axis, path in zip(axes, (real, dataset), strict=True):
        recording = open_recording(Path(path))
        points = cropped(recording.read(len(recording) // 2).points)
        points = points[np.argsort(points[:, 2])]
        axis.scatter(*points[:, :2].T, s=0.15, c=points[:, 2], cmap="turbo", vmin=-2.4, vmax=2)
        axis.set(xlim=(-40, 40), ylim=(-40, 40), aspect="equal")
        axis.axis("off")
    figure.subplots_adjust(0, 0, 1, 1, 0.01)
    figure.savefig(out, dpi=80)


def realism_of(real, datasets):
    """Print mean and standard deviation of realism over draws, and the means of its parts."""

    def cloud(path):
        return np.concatenate([cropped(frame.points) for frame in open_recording(Path(path))])

    truth = cloud(real)
    for path in datasets:
        other, rows = cloud(path), []
        for draw in range(DRAWS):
            a, b = (sampled(side, POINTS, SEED + draw) for side in (truth, other))
            rows.append(
                [
                    chamfer_squared(nearest_distances(a, b)),
                    mean_discrepancy(a, b, most=EMD_POINTS, seed=SEED + draw),
                    earth_mover(a, b, most=EMD_POINTS, seed=SEED + draw),
                    frechet_places(a, b),
                ]
            )
        names = ("CD", "MMD", "EMD", "FPD")
        score = [
            np.mean([normalised(*one) for one in zip(names, row, strict=True)]) for row in rows
        ]
        parts = ", ".join(f"{n} {v:.3g}" for n, v in zip(names, np.mean(rows, axis=0), strict=True))
        print(f"{path}: realism {np.mean(score):.3f} +- {np.std(score):.3f} ({parts})", flush=True)


def side_of(name, path):
    recording = cropped_recording(open_recording(Path(path)), CROP_M)
    side = Side(name, recording, len(recording))
    model_background(side)
    return side


def windows(real, others):
    """Print background and objects of datasets against real frames; the first is real itself."""
    truth = side_of("real", real)
    sides = [side_of("synthetic", path) for path in others]
    ground = ground_beneath(truth)
    origin = truth.read(0).sensor_places[0]
    figures = [[] for _ in others]
    found = [[] for _ in range(1 + len(others))]
    for index in range(truth.count):
        frame = truth.read(index)
        moves = truth.foreground(frame, MODEL)
        found[0].append(objects_of(frame.points[moves], ground))
        surface = RealSurface(frame.points, origin)
        still = histograms_of(frame.only(~moves).cloud, intensity_scale=None, origin=origin)
        for side, rows, objects in zip(sides, figures, found[1:], strict=True):
            other = side.read(index)
            away = side.foreground(other, MODEL)
            objects.append(objects_of(other.points[away], ground))
            near = nearest_distances(frame.points, other.points)
            mine = NearestDistances(near.real_to_synthetic[~moves], near.synthetic_to_real[~away])
            some, mesh = surface.sampled_distances(other.points)
            its = histograms_of(other.only(~away).cloud, intensity_scale=None, origin=origin)
            js = divergences(still, its)["mean"]
            rows.append([P95Hausdorff.of(mine).both, js, mesh[~away[some]].mean()])
        print(f"frame {index + 1} of {truth.count}", flush=True)
    every = []
    for path, rows, objects in zip(others, figures, found[1:], strict=True):
        between = object_divergences(np.concatenate(found[0]), np.concatenate(objects))
        told = [np.nan if one is None else one for one in between.values()]
        every.append([*np.mean(rows, axis=0), *told, np.mean([*map(len, objects)])])
        print(path, np.round(every[-1], 4))
    names = ("P95 m", "JS", "point to mesh m", *between, "objects a frame")
    for column, name in enumerate(names):
        base, *rest = (row[column] for row in every)
        print(f"{name}: real {base:.4g}, others {np.mean(rest):.4g} +- {np.std(rest):.2g}", end="")
        print(f", {np.mean(rest) / base:.2f} +- {np.std(rest) / base:.2f} times")


def spacing(observed, motion):
    """Print by how many frames later the same vehicles stand there, observed and simulated."""

    def stays(moments):
        found = []
        for lag in range(1, len(moments)):
            pairs = [one for one in zip(moments, moments[lag:], strict=False) if len(one[1])]
            same = sum((cKDTree(later).query(now)[0] < SAME_M).sum() for now, later in pairs)
            found.append(same / max(sum(len(now) for now, _ in pairs), 1))
        return np.array(found)

    motors = ("car", "van", "truck", "bus")
    tracks = pd.read_csv(Path(observed) / "tracks.csv")
    tracks = tracks[tracks["class"].isin(motors)]
    every = [one[["x", "y"]].to_numpy() for _, one in tracks.groupby("time_s")]
    print("observed", np.round(stays(every), 2))
    half = np.abs(tracks[["x", "y"]].to_numpy()).max()
    actors = pd.read_parquet(Path(motion) / "actors.parquet", columns=["time_s", "class", "x", "y"])
    inside = actors[["x", "y"]].abs().max(axis=1) < half
    actors = actors[actors["class"].isin(motors) & inside]
    at = {round(10 * t): one[["x", "y"]].to_numpy() for t, one in actors.groupby("time_s")}
    for seconds in (1, 2, 5, 8, 10, 13, 17, 20):
        step = 10 * seconds
        starts = range(0, max(at) - len(every) * step, 70)
        told = [stays([at.get(s + k * step, NOBODY) for k in range(len(every))]) for s in starts]
        if told:
            print(f"every {seconds} s", np.mean(told, axis=0).round(2))


def frame_of(dataset):
    """Return range, beam, label and point (N, 3) of what came back in a dataset's first frame."""
    file = min((dataset / "points").glob("*.npy"))
    points = np.load(file)[:, :3].astype(float)
    rays = np.load(dataset / "rays" / file.name)
    label = np.fromfile(dataset / "semantic" / f"{file.stem}.label", "<u4")
    beam = (rays["sensor"].astype(np.int64) << 40) + (rays["ring"].astype(np.int64) << 20)
    return np.linalg.norm(points, axis=1), beam + rays["column"], label, points


def judge_beams(true, rebuilt):
    range_m, beam, label, points = frame_of(true)
    kept = (range_m < REACH_M) & (label >> 16 == 0)
    range_m, beam, kind, points = range_m[kept], beam[kept], label[kept] & 0xFFFF, points[kept]
    other_m, other, _, there = frame_of(rebuilt)
    _, mine, its = np.intersect1d(beam, other, return_indices=True)
    off = np.abs(range_m[mine] - other_m[its])
    print(f"{len(mine) / len(beam):.1%} of {len(beam)} beams come back in both; of these")
    print(f"  median {np.median(off):.3f} m; within 0.05 m {(off < 0.05).mean():.1%},", end=" ")
    print(f"0.2 m {(off < 0.2).mean():.1%}, 1 m {(off < 1).mean():.1%}")
    for one in semantic_classes().values():
        of = kind[mine] == one.id
        if of.sum() > 200:
            print(f"  {one.name}: {of.sum()} beams, within 0.1 m {(off[of] < 0.1).mean():.1%}")
    near = there[other_m < REACH_M]
    for name, a, b in (("true to rebuilt", points, near), ("rebuilt to true", near, points)):
        print(f"  P95 {name} {np.percentile(cKDTree(b).query(a)[0], 95):.2f} m")


def judge_ground(true, rebuilt, rings):
    axis = np.arange(-HALF_M, HALF_M, STEP_M)
    xy = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)

    def height(twin):
        ground = twin.ground_mesh
        top = np.full(len(xy), ground.vertices[:, 2].max() + 1)
        return DownwardProbe(ground).height_below(np.column_stack([xy, top]))

    off = np.abs(height(ut.open(rebuilt)) - height(ut.open(true)))
    cloud = read_recording(rings).cloud
    seen = cKDTree(cloud.points[cloud.classification == 2, :2]).query(xy)[0] < STEP_M / 2
    for name, some in (("measured", seen), ("filled", ~seen)):
        here = off[some & np.isfinite(off)]
        told = ", ".join(f"P{p} {np.percentile(here, p):.3f}" for p in (50, 90, 95))
        print(f"ground {name}: {some.mean():.1%} of {2 * HALF_M:g} m squared, off by {told} m")


if __name__ == "__main__":
    what, *given = sys.argv[1:]
    if what == "picture":
        picture(*given)
    elif what == "windows":
        windows(given[0], given[1:])
    elif what == "realism":
        realism_of(given[0], given[1:])
    elif what == "spacing":
        spacing(*given)
    else:
        truth, made, true_twin, made_twin, recorded = map(Path, given)
        judge_beams(truth, made)
        judge_ground(true_twin, made_twin, recorded)
