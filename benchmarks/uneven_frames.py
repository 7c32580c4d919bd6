"""Frames of known traffic that are not evenly spaced, observed (docs/howto/recorded_traffic.md).

    python benchmarks/uneven_frames.py TWIN DATASET [TWIN DATASET ...]

Datasets are of a rig with `frame: site` and rings, a frame a second (`record --every 10`) over 300
seconds. Of each, 24 frames a second apart, ten seconds apart, and a second apart with gaps of 5 to
40 s after two of five (five draws), are observed three times: as if all were a second apart, with
gaps that are found, and with times that are told. Printed are the share of pairs of frames that
were told rightly, of boxes in tracks the share that is of the actor whom most of the track's are
of, recall and precision within 30 m of the first sensor, and how far the speeds of tracks are off.
"""

import json
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import linear_sum_assignment

from urbantwin.reconstruct.recording import RecordedFrames
from urbantwin.traffic.observed import FrameTimes, observe
from urbantwin.traffic.observed.frame_times import LONGEST_S, evenly_spaced
from urbantwin.twin import load_twin

FRAMES, DRAWS, REACH_M, NEAR_M, LEAST_POINTS = 24, 5, 60.0, 30.0, 10
GAPS, GAP_S = 0.4, (5, 41)
KINDS = {
    "motor": ("car", "van", "truck", "bus"),
    "on foot": ("pedestrian",),
    "two wheels": ("bicycle", "motorcycle"),
}
WITHIN_M = {"motor": 2.0, "on foot": 1.0, "two wheels": 1.0}


def choices(count):
    """Return the numbers of frames of each choice, by name."""
    found = {f"even {k}": np.arange(FRAMES) + 90 * k for k in range(3)}
    found |= {f"ten seconds {k}": 10 * np.arange(FRAMES) + 20 * k for k in range(3)}
    for draw in range(1, DRAWS + 1):
        random = np.random.default_rng(draw)
        at = [int(random.integers(0, 10))]
        while len(at) < FRAMES:
            at.append(at[-1] + (int(random.integers(*GAP_S)) if random.random() < GAPS else 1))
        found[f"gaps {draw}"] = np.array(at)
    return {name: at[at < count] for name, at in found.items()}


def write_rings(dataset, names, folder):
    """Write frames of a dataset as `rig discover --frames` does, with the rig's own rings."""
    for part in ("points", "rays"):
        (folder / part).mkdir(parents=True)
    sensors = []
    for one in json.loads((dataset / "dataset.json").read_text())["rig"]["sensors"]:
        east, north, up = (row[3] for row in one["site_SE3_sensor"][:3])
        pose = {"east_m": east, "north_m": north, "up_m": up, "pitch_deg": 0.0, "roll_deg": 0.0}
        channels = len(one["sensor"]["elevation_deg"])
        sensors.append(
            {"name": one["name"], "columns": one["columns"], "channels": channels, **pose}
        )
    (folder / "discovery.json").write_text(json.dumps({"kind": "discovery", "sensors": sensors}))
    middle = np.array([sensors[0]["east_m"], sensors[0]["north_m"]])
    for name in names:
        points = np.load(dataset / "points" / f"{name}.npy")[:, :3]
        rays = np.load(dataset / "rays" / f"{name}.npy")
        near = np.linalg.norm(points[:, :2] - middle, axis=1) < REACH_M
        table = np.zeros(near.sum(), [(one, "<i4") for one in ("sensor", "ring", "column")])
        for one in table.dtype.names:
            table[one] = rays[one][near]
        np.save(folder / "points" / f"{name}.npy", points[near])
        np.save(folder / "rays" / f"{name}.npy", table)
    return middle


def judged(found, boxes, names, middle, sums):
    """Add up what is right of an observation."""
    rows = [
        (number, one, frame, *box[:2])
        for number, one in enumerate(found.tracks)
        for frame, box in zip(one.frames, one.boxes, strict=True)
    ]
    owners = defaultdict(list)
    for frame, name in enumerate(names):
        true = boxes[boxes.frame == name]
        away = np.hypot(true.x - middle[0], true.y - middle[1])
        mine = [one for one in rows if one[2] == frame]
        for kind, classes in KINDS.items():
            own = true[(away < NEAR_M) & true["class"].isin(classes)]
            own = own[own.num_points >= LEAST_POINTS]
            seen = np.array([one[3:] for one in mine if one[1].actor_class in classes])
            seen = seen.reshape(-1, 2)
            seen = seen[np.linalg.norm(seen - middle, axis=1) < NEAR_M]
            off = np.linalg.norm(seen[:, None] - own[["x", "y"]].to_numpy()[None], axis=2)
            met = off[linear_sum_assignment(np.minimum(off, 99))] < WITHIN_M[kind]
            sums[f"{kind} recall"] += met.sum(), len(own)
            sums[f"{kind} precision"] += met.sum(), len(seen)
        for number, _, _, x, y in mine:
            off = np.hypot(true.x - x, true.y - y).to_numpy()
            if len(off) and off.min() < 2.0:
                owner = true.iloc[int(off.argmin())]
                owners[number].append((owner.track, np.hypot(owner.vx, owner.vy)))
            elif np.hypot(x - middle[0], y - middle[1]) < NEAR_M:
                owners[number].append((-1, np.nan))
    for number, every in owners.items():
        if len(every) > 1:
            who = [one for one, _ in every]
            sums["boxes of one actor"] += max(map(who.count, who)), len(who)
            track, speeds = found.tracks[number], [one for who, one in every if who >= 0]
            if track.moves and speeds:
                sums["speed off, m/s"] += abs(track.speed - np.median(speeds)), 1


def observed(roads, dataset, sums):
    """Observe all choices of a dataset's frames, and add up what is right."""
    every = sorted(path.stem for path in (dataset / "points").glob("*.npy"))
    boxes = pd.read_parquet(dataset / "boxes.parquet")
    for choice, numbers in choices(len(every)).items():
        names, time_s = [every[k] for k in numbers], (numbers - numbers[0]).astype(float)
        gap = np.diff(time_s) > LONGEST_S
        with tempfile.TemporaryDirectory() as scratch:
            middle = write_rings(dataset, names, Path(scratch) / "rings")
            frames = RecordedFrames(Path(scratch) / "rings")
            for how, times in (
                ("as if even", evenly_spaced(len(names), 1.0)),
                ("found", None),
                ("told", FrameTimes(time_s, gap, told=True)),
            ):
                found = observe(frames, roads, rate_hz=1.0, times=times)
                mine = sums[choice.rstrip("0123456789 "), how]
                right = [(found.times.gap == gap).sum(), len(gap)]
                mine["pairs told rightly"] += right
                judged(found, boxes, names, middle, mine)


def main(given):
    sums = defaultdict(lambda: defaultdict(lambda: np.zeros(2)))
    for twin, dataset in zip(given[::2], given[1::2], strict=True):
        observed(load_twin(twin).roads, dataset, sums)
    for (choice, how), every in sums.items():
        for what, (right, of) in every.items():
            print(f"{choice}, {how}: {what} {right / max(of, 1):.3f} of {of:.0f}")


if __name__ == "__main__":
    main([Path(one) for one in sys.argv[1:]])
