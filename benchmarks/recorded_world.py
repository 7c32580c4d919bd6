"""How near a twin built from a recording is to the place (docs/recording_source.md).

    python benchmarks/recorded_world.py crop dataset/ cropped/ 40 40 5
    python benchmarks/recorded_world.py judge DATASET REBUILT_DATASET TWIN REBUILT_TWIN RINGS

`crop` cuts the points of a dataset to what a recording was cropped to, with their rays, for
`urbantwin compare`. `judge` compares what one rig records in a true twin and in one that was
rebuilt from another rig's recording of it, beam by beam, and the heights of their ground.
"""

import shutil
import sys
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import urbantwin as ut
from urbantwin.geometry import DownwardProbe
from urbantwin.reconstruct.recording.recorded_world import read_recording
from urbantwin.taxonomy import semantic_classes

REACH_M = 45.0
HALF_M, STEP_M = 35.0, 0.5


def crop(dataset, out, *half_m):
    """Write points and rays within so much of the frame's origin, as ``compare`` reads them."""
    for part in ("points", "rays"):
        (out / part).mkdir(parents=True)
    for name in ("dataset.json", "sweeps.parquet"):
        shutil.copy(dataset / name, out / name)
    for file in sorted((dataset / "points").glob("*.npy")):
        points = np.load(file)
        kept = (np.abs(points[:, :3]) <= half_m).all(axis=1)
        np.save(out / "points" / file.name, points[kept, :3])
        np.save(out / "rays" / file.name, np.load(dataset / "rays" / file.name)[kept])


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
    if what == "crop":
        crop(Path(given[0]), Path(given[1]), *map(float, given[2:5]))
    else:
        truth, made, true_twin, made_twin, recorded = map(Path, given)
        judge_beams(truth, made)
        judge_ground(true_twin, made_twin, recorded)
