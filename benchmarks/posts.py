"""How wide posts look before several sensors at several distances: what their beams add.

    urbantwin rig discover first/ -o rig.yaml --frames rings/
    python benchmarks/posts.py rings/

A post that several sensors of a recording see is as wide for all of them. Before each it is as wide
as its beams that come back from it are apart, rays times azimuth step times distance, so what grows
with the distance is the beam's: width + spread x distance. One spread for each sensor and one width
for each post are fitted to all, weakly held to 1.5 mrad. Rows of a ring are posts where up to 12
neighbours of one range stand at least 0.7 m before what is on both sides of them.
"""

import json
import sys
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

#: Rays of one surface, metres apart in range; what stands behind, metres; rays of a post at most.
SAME_M, BEHIND_M, MOST = 0.25, 0.7, 12
#: Ranges that count; places of one post, metres apart; its greatest extent.
SPAN_M, JOINED_M, WIDEST_M = (3.0, 45.0), 0.06, 0.6
#: Rows of a post, and of a sensor before it.
FEWEST_ROWS, FEWEST_SEEN = 40, 15


def rows_of(folder, sensors):
    """Return rows of posts: x, y, z, range, rays, ring, frame, sensor."""
    rows = []
    for frame, path in enumerate(sorted((folder / "points").glob("*.npy"))):
        points = np.load(path).astype(float)
        rays, moving = (np.load(folder / part / path.name) for part in ("rays", "moving"))
        for number, one in enumerate(sensors):
            mine = (rays["sensor"] == number) & (rays["column"] >= 0)
            place = np.array([one["east_m"], one["north_m"], one["up_m"]])
            there, ray = points[mine], rays[mine]
            away = np.linalg.norm(there - place, axis=1)
            image = np.full((one["channels"], one["columns"]), np.inf)
            index = np.full(image.shape, -1)
            order = np.argsort(-away)  # of two returns the nearer stays
            at = ray["ring"][order], ray["column"][order] % one["columns"]
            image[at], index[at] = away[order], order
            for ring, row in enumerate(image):
                for a, b in runs_of(row):
                    found = index[ring, a:b]
                    if not moving[mine][found].any():
                        middle = there[found].mean(axis=0)
                        rows.append((*middle, row[a:b].mean(), b - a, ring, frame, number))
    return np.array(rows)


def runs_of(row):
    """Yield where neighbours of a ring begin and end that stand before what is beside them."""
    with np.errstate(invalid="ignore"):
        breaks = np.flatnonzero(~(np.abs(np.diff(row)) < SAME_M)) + 1
    for a, b in zip(np.r_[0, breaks], np.r_[breaks, len(row)], strict=True):
        range_m = row[a:b].mean()
        if b - a > MOST or a < 3 or b > len(row) - 3 or not SPAN_M[0] < range_m < SPAN_M[1]:
            continue
        if all(
            range_m + BEHIND_M < side.min() < np.inf for side in (row[a - 3 : a], row[b : b + 3])
        ):
            yield a, b


def widths_of(rows, sensors, frames):
    """Return of each post by sensor: distance, how wide it looks, and of how many rings."""
    near = cKDTree(rows[:, :2]).query_pairs(JOINED_M, output_type="ndarray")
    graph = coo_array((np.ones(len(near)), near.T), shape=(len(rows), len(rows)))
    _, post = connected_components(graph, directed=False)
    for number in range(post.max() + 1):
        one = rows[post == number]
        if len(one) < FEWEST_ROWS or np.ptp(one[:, :2], axis=0).max() > WIDEST_M:
            continue
        seen = {}
        for k, sensor in enumerate(sensors):
            mine = one[one[:, 7] == k]
            if len(mine) < FEWEST_SEEN:
                continue
            rings, start = np.unique(mine[:, 5], return_inverse=True)
            looks = np.bincount(start)
            if len(rings) > 4:  # the uppermost and the lowest may meet its ends
                looks[[0, -1]] = 0
            rays = np.bincount(start, mine[:, 4])[looks >= frames / 2] / frames
            if len(rays) >= 2:
                away = mine[:, 3].mean()
                step = np.radians(sensor["azimuth_step_deg"])
                seen[k] = away, float(np.median(rays) * away * step), len(rays)
        if len(seen) >= 2:
            yield one[:, :2].mean(axis=0), seen


def main():
    folder = Path(sys.argv[1])
    found = json.loads((folder / "discovery.json").read_text())
    sensors, frames = found["sensors"], found["frames"]
    posts = list(widths_of(rows_of(folder, sensors), sensors, frames))
    for place, seen in posts:
        each = (
            f"{sensors[k]['models'][0]} at {away:.1f} m {100 * wide:.1f} cm ({rings} rings)"
            for k, (away, wide, rings) in seen.items()
        )
        print(f"post at {place[0]:.1f}, {place[1]:.1f}: {', '.join(each)}")

    count = len(posts)
    rows = [(p, k, *one) for p, (_, seen) in enumerate(posts) for k, one in seen.items()]
    post, sensor, away, wide, rings = (np.array(column) for column in zip(*rows, strict=True))
    step = np.radians([sensors[k]["azimuth_step_deg"] for k in sensor])
    weight = np.sqrt(rings) / (away * step)

    def off(values):
        told = values[post] + values[count + sensor] * away
        return np.concatenate([(told - wide) * weight, (values[count:] - 0.0015) * 300])

    begin = np.concatenate([np.full(count, 0.1), np.full(len(sensors), 0.002)])
    solved = least_squares(off, begin, loss="soft_l1", f_scale=0.3)
    spare = max(len(wide) - len(begin), 1)
    spread = np.sqrt(np.diag(np.linalg.inv(solved.jac.T @ solved.jac)) * 2 * solved.cost / spare)
    for k, one in enumerate(sensors):
        value, sigma = 1e3 * solved.x[count + k], 1e3 * spread[count + k]
        print(f"{one['models'][0]}: {value:.1f} +- {sigma:.1f} mrad, {np.sum(sensor == k)} posts")


if __name__ == "__main__":
    main()
