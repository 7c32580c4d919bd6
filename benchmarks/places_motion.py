"""How a motion drives and how a dataset sees it: see `driving` and `seeing` for each value."""

from __future__ import annotations

from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import shapely
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from urbantwin.interface.coverage_map import coverage
from urbantwin.interface.dataset import Dataset
from urbantwin.taxonomy import semantic_id
from urbantwin.traffic import Motion
from urbantwin.traffic.paths.coupling import towed_by
from urbantwin.twin import Twin

#: No impossible curve, m/s2; smoothed over this time, below which SUMO's steps show, seconds.
COMFORTABLE_M_S2, SMOOTHED_S = 4.0, 0.5
#: Actors overlap when their boxes share more than this in plan, m2, on one level.
OVERLAP_M2, LEVEL_M = 0.05, 2.0
#: Overlaps are looked for so often, seconds.
EVERY_S = 0.5
#: Slower than this is standing, m/s; so far before a stop line is at it, metres.
STANDING_M_S, AT_STOP_LINE_M = 0.3, 12.0
#: What lies nearer to the sensor is in its way, metres.
NEAR_M = 10.0
#: The junction reaches this far from the anchor, metres.
JUNCTION_M = 50.0


def who_drive(motion: Motion) -> pa.Table:
    """Return the rows of who drives or rides."""
    on_foot = pa.array(["pedestrian", "animal"])
    return motion.actors.filter(pc.invert(pc.is_in(motion.actors["class"], on_foot)))


def driving(twin: Twin, motion: Motion) -> dict[str, Any]:
    """Measure a motion.

    Returns:
        ``carried``: share of the motor traffic asked for, as the motion says, and
        ``share_of_guess``, of what was guessed that is asked for. ``stops_at_red``:
        vehicles that stood at a red stop line, and those that stood or crossed one while every
        link of their lane was red. ``lateral``: vehicles over 4 m/s2, all vehicles, and the most.
        ``braking``: the strongest, m/s2. ``overlaps``: pairs of actors whose boxes overlap at any
        time. ``moved``: vehicles that went 5 m or more, of all. ``teleports``, ``collisions``.
    """
    told = motion.manifest
    circulation = told.get("circulation", {})
    vehicles = who_drive(motion)
    lateral, braking, moved, turns = {}, {}, 0, {}
    for track, rows in _tracks(vehicles).items():
        moved += np.hypot(np.ptp(rows["x"]), np.ptp(rows["y"])) >= 5.0
        steps = max(round(SMOOTHED_S / motion.step_s), 1)
        # A vehicle that leaves the region and comes back has no rows between.
        gaps = np.flatnonzero(np.diff(rows["time_s"]) > 1.5 * motion.step_s) + 1
        for part in np.split(np.arange(len(rows["time_s"])), gaps):
            if len(part) <= 2 * steps:
                continue
            speed, yaw = rows["speed"][part], np.unwrap(rows["yaw"][part])
            rate = uniform_filter1d(np.gradient(yaw, motion.step_s), steps)
            gained = uniform_filter1d(np.gradient(speed, motion.step_s), steps)
            for most, value in (
                (lateral, float(np.abs(rate * speed).max())),
                (turns, float(np.degrees(np.abs(rate).max()))),
                (braking, float(-gained.min())),
            ):
                most[track] = max(most.get(track, 0.0), value)
    over = [track for track, most in lateral.items() if most > COMFORTABLE_M_S2]
    pairs = overlaps(motion)
    return {
        "carried": circulation.get("carried_share_of_motor_traffic"),
        "share_of_guess": circulation.get("share_of_guess"),
        "asked": {k: v["per_hour"] for k, v in told["classes"].items() if v["per_hour"]},
        "seen": {name: row["seen"] for name, row in told["classes"].items() if row["seen"]},
        "stops_at_red": stops_at_red(twin, motion),
        "lateral": [len(over), len(lateral), round(max(lateral.values(), default=0.0), 1)],
        "lateral_over": {track: round(lateral[track], 1) for track in sorted(over)},
        "fastest_turn_deg_s": round(max(turns.values(), default=0.0)),
        "braking": round(max(braking.values(), default=0.0), 1),
        "overlaps": len(pairs),
        "overlapping": dict(Counter(" and ".join(kinds) for kinds in pairs.values())),
        "moved": [int(moved), len(_tracks(vehicles))],
        "teleports": told["teleports"],
        "collisions": told["collisions"],
        "longest_halt_s": circulation.get("longest_halt_s"),
    }


def _tracks(table: pa.Table) -> dict[int, dict[str, NDArray[Any]]]:
    """The rows of each track, by time: columns as arrays."""
    order = np.lexsort((table["time_s"].to_numpy(), table["track"].to_numpy()))
    columns = {
        name: np.array(table[name].to_pylist() if name == "lane" else table[name].to_numpy())[order]
        for name in ("track", "time_s", "x", "y", "yaw", "speed", "lane", "length")
    }
    tracks, first = np.unique(columns["track"], return_index=True)
    parts = {name: np.split(column, first[1:]) for name, column in columns.items()}
    return {
        int(track): {name: parts[name][number] for name in columns}
        for number, track in enumerate(tracks)
    }


def overlaps(motion: Motion) -> dict[tuple[int, int], tuple[str, str]]:
    """Classes of the pairs of actors whose boxes overlap, each pair once.

    Bodies of one vehicle lie over each other where they hang together.
    """
    found: dict[tuple[int, int], tuple[str, str]] = {}
    whole = towed_by(motion.rows)
    for time_s in motion.times()[:: max(round(EVERY_S / motion.step_s), 1)]:
        rows = motion.at(float(time_s))
        if not len(rows):
            continue
        ahead = np.column_stack([np.cos(rows["yaw"]), np.sin(rows["yaw"])])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        ahead *= rows["length"][:, None].astype(float) / 2
        left *= rows["width"][:, None].astype(float) / 2
        middle = np.column_stack([rows["x"], rows["y"]]).astype(float)
        corners = [middle + a * ahead + b * left for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        boxes = shapely.polygons(np.stack(corners, axis=1))
        one, other = shapely.STRtree(boxes).query(boxes, predicate="intersects")
        pairs = (one < other) & (np.abs(rows["z"][one] - rows["z"][other]) < LEVEL_M)
        one, other = one[pairs], other[pairs]
        deep = shapely.area(shapely.intersection(boxes[one], boxes[other])) > OVERLAP_M2
        for a, b in zip(one[deep], other[deep], strict=True):
            tracks = int(rows["track"][a]), int(rows["track"][b])
            if whole.get(tracks[0]) == tracks[1] or whole.get(tracks[1]) == tracks[0]:
                continue
            kinds = sorted((rows["class"][a], rows["class"][b]))
            found[tracks] = (kinds[0], kinds[1])
    return found


def stops_at_red(twin: Twin, motion: Motion) -> list[int]:
    """Vehicles that stood at a red stop line, and those that stood at or crossed one."""
    links: dict[str, list[tuple[str, int]]] = defaultdict(list)
    for head in twin.roads.signals:
        if twin.roads.lane_by_id[head.lane].kind != "crossing":
            links[head.lane] += [(head.program, link) for link in head.links]
    states: dict[tuple[str, int], tuple[list[float], list[str]]] = defaultdict(lambda: ([], []))
    for row in motion.signals.to_pylist():
        times, told = states[row["signal"], row["link"]]
        times.append(row["time_s"])
        told.append(row["state"])

    def is_red(lane: str, time_s: float) -> bool:
        shown = []
        for key in links[lane]:
            times, told = states[key]
            at = int(np.searchsorted(times, time_s + 1e-6)) - 1
            shown.append(told[at] if at >= 0 else "o")
        return bool(shown) and set(shown) == {"r"}

    stood, ran = set(), set()
    vehicles = who_drive(motion)
    for track, rows in _tracks(vehicles).items():
        lane, speed = rows["lane"], rows["speed"]
        for k in np.flatnonzero([name in links for name in lane]):
            last = k + 1 == len(lane)
            if not last and lane[k + 1] != lane[k] and lane[k + 1].startswith(":"):
                # Whoever crosses within a second of the change could not have stopped.
                if is_red(lane[k], rows["time_s"][k] - 1.0) and is_red(lane[k], rows["time_s"][k]):
                    ran.add(track)
            elif speed[k] < STANDING_M_S and is_red(lane[k], rows["time_s"][k]):
                end = twin.roads.lane_by_id[lane[k]].centre[-1]
                away = np.hypot(rows["x"][k] - end[0], rows["y"][k] - end[1])
                if away - rows["length"][k] / 2 < AT_STOP_LINE_M:
                    stood.add(track)
    return [len(stood), len(stood | ran)]


def seeing(dataset: Dataset) -> dict[str, Any]:
    """Measure a dataset.

    Returns:
        ``with_points``: share of the boxes within the region, in reach of a sensor, that have any,
        by class. ``actors_with_points``: actors that have points in any frame, of those that are
        ever within the region, by class. ``near``: share of all points that are nearer than 10 m
        to the sensor. ``points_per_frame``.
    """
    boxes = dataset.boxes.select(["track", "class", "num_points", "ignored"]).to_pydict()
    count: Counter[str] = Counter()
    hit: Counter[str] = Counter()
    actors, seen = defaultdict(set), defaultdict(set)
    for track, kind, points, why in zip(*boxes.values(), strict=True):
        if why in ("outside", "far"):
            continue
        count[kind] += 1
        hit[kind] += points > 0
        actors[kind].add(track)
        if points:
            seen[kind].add(track)
    near = total = 0
    origins = _sensor_origins(dataset)
    for frame in list(dataset)[:: max(len(dataset) // 20, 1)]:
        places = origins[frame.rays["sensor"]]
        away = np.linalg.norm(frame.points[:, :3] - places, axis=1)
        near += int((away < NEAR_M).sum())
        total += len(away)
    return {
        "with_points": {k: round(hit[k] / count[k], 3) for k in sorted(count)},
        "with_points_all": round(hit.total() / max(count.total(), 1), 3),
        "actors_with_points": {k: [len(seen[k]), len(actors[k])] for k in sorted(actors)},
        "near": round(near / max(total, 1), 3),
        "points_per_frame": round(dataset.manifest["counts"]["points"] / len(dataset)),
    }


def _sensor_origins(dataset: Dataset) -> NDArray[np.float64]:
    """Where the sensors are in the frame of the points (S, 3)."""
    to_dataset = np.array(dataset.manifest["dataset_SE3_site"])
    sensors = dataset.manifest["rig"]["sensors"]
    places = np.array([np.array(one["site_SE3_sensor"])[:3, 3] for one in sensors])
    return np.asarray(places @ to_dataset[:3, :3].T + to_dataset[:3, 3])


def street_covered(twin: Twin, folder: Path) -> dict[str, float]:
    """Shares of the street about the anchor that get a point per square metre and frame.

    By the twin's own rig in the static world without actors, as ``urbantwin rig coverage`` says:
    ``facing``, on a dark surface 1 m above the street that faces the sensor, as the side of a car;
    ``ground``, on the street itself, where beams at 30 m graze so flatly that few come back. In
    cells of 2 m: at 50 m the beams of a turn are farther apart on the ground than smaller ones.
    """
    found = coverage(twin, folder, cell=2.0, pictures=False, progress=False).densities
    cells = found.cells
    rows, columns = np.indices(cells.shape) + 0.5
    x, y = cells.x0 + columns * cells.size_m, cells.y0 + rows * cells.size_m
    street = np.isin(cells.semantic, [semantic_id(name) for name in ("road", "parking")])
    street &= (np.hypot(x, y) <= JUNCTION_M) & shapely.contains_xy(twin.region, x, y)
    lit = {layer: found.per_frame(layer)[street] >= 1.0 for layer in ("facing", "ground")}
    return {layer: round(float(one.mean()), 3) if one.size else 0.0 for layer, one in lit.items()}
