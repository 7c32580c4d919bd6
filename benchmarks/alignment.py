"""How often what `urbantwin rig align` states is so: many sites, sensors, starts and wrong maps.

A street is a twin with parked cars and hedges that no map has. It is scanned from roofs and poles,
by a sensor that stands still now and then more than once, while others pass. It is aligned with
maps of it that are wrong as maps are (edges and heights by smooth errors, houses by 0.35 m, every
third pole and tree missing) and of which more may be missing: see `MAPS`. Guesses lie somewhere
within their span, at its very edge, or so that the truth lies beyond it. The truth is known.

Twins of streets that are hard: `alignment_streets.py`.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment import Guess, align
from urbantwin.fidelity.alignment.pose_average import averaged
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.lidar import place_rig
from urbantwin.lidar.scanner import Scanner
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import GROUND_CLASSES, material_id, semantic_id
from urbantwin.twin import Twin, load_twin

#: A sensor, how high above the ground, and whether it stands beside the street.
SENSORS = (
    ("VLP-32C", 1.9, False), ("HDL-64E S3", 1.8, False), ("VLP-16", 1.9, False),
    ("OS0-128", 1.8, False), ("Pandar64", 1.9, False), ("OS1-128", 5.5, True),
    ("OS2-128", 6.0, True), ("VLP-16", 4.0, True), ("OS0-128", 4.5, True), ("Pandar64", 5.0, True),
)  # fmt: skip
#: What a map has: all that is mapped; that, but on one side of the street alone; the ground; the
#: ground and the cars that were parked there before, of which a third drove off; poles on bare
#: ground, without edges and paint. One of each row is drawn for a frame.
MAPS = (("all", "all", "side"), ("ground", "cars", "poles"))
#: Where the truth lies in the guess's span, and how often (of 20 cases).
GUESSES = ("inside",) * 11 + ("edge",) * 7 + ("beyond",) * 2
#: How often a sensor that stands still is read more than once, and how many frames.
STANDS, FRAMES = 0.1, 2
#: How wrong a map is, standard deviations in metres: edges in plan and heights over 15 m, houses.
EDGES_M, HEIGHTS_M, HOUSES_M, ALIKE_M = 0.12, 0.05, 0.35, 15.0
#: How far off the guess may be: metres and degrees.
SPANS = ((0.5, 2.0), (3.0, 15.0), (3.0, 15.0), (12.0, 20.0))
#: A parked car or a hedge may be every so many metres of a lane.
SPOT_M = 8.0
_GROUND = [semantic_id(name) for name in GROUND_CLASSES]


@dataclass(frozen=True)
class Case:
    """One frame, or some, one map, one guess."""

    site: str
    sensor: str
    map: str
    place: int
    within_m: float
    within_deg: float
    guess: str
    frames: int


@dataclass(frozen=True)
class Scans:
    """What a sensor that stands still saw, where it was, and the boxes that stood there."""

    frames: list[Frame]
    true: Pose
    boxes: list[LabelledMesh]


def clutter(twin: Twin, generator: np.random.Generator, often: float = 0.25) -> list[LabelledMesh]:
    """Return parked cars and hedges beside the lanes, as boxes."""
    parts = []
    for lane in twin.roads.lanes:
        if not lane.road or "car" not in lane.allowed:
            continue
        line = np.asarray(lane.centre)
        run = np.append(0.0, np.cumsum(np.hypot(*np.diff(line[:, :2], axis=0).T)))
        for spot in np.arange(SPOT_M / 2, run[-1], SPOT_M):
            if generator.random() > often:
                continue
            k = int(np.searchsorted(run, spot))
            along = line[k, :2] - line[k - 1, :2]
            along /= np.hypot(*along)
            aside = np.array([along[1], -along[0]]) * generator.choice([2.2, 3.5, 5.5])
            middle = line[k, :2] + along * generator.uniform(-1.5, 1.5) + aside
            low = generator.random() < 0.7
            size = np.array([4.4, 1.8, 1.5]) if low else np.array([8.0, 0.8, 1.3])
            pose = Pose.from_ypr(
                [*middle, line[k, 2] + size[2] / 2 + 0.1], np.arctan2(*along[::-1])
            )
            parts.append(box(size, low).transformed(pose))
    return parts


def box(size: np.ndarray, car: bool) -> LabelledMesh:
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * size / 2
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))]
    kind = ("car", "metal-painted") if car else ("vegetation", "foliage")
    return LabelledMesh.build(corners, faces, semantic_id(kind[0]), material_id(kind[1]))


def wrong_map(
    mesh: LabelledMesh, kind: str, scans: Scans, generator: np.random.Generator
) -> LabelledMesh:
    """Return a mesh as a map of some kind would have it."""
    mesh = _of_kind(mesh, kind, scans, generator)
    ground = np.isin(mesh.semantic, _GROUND)
    part = mesh.part[~ground]
    numbers = np.unique(part)
    building = np.isin(mesh.semantic, semantic_id("building"))
    houses = np.unique(mesh.part[building])
    missing = numbers[generator.random(len(numbers)) < 1 / 3]
    missing = np.setdiff1d(missing, houses)
    mesh = mesh.select(ground | ~np.isin(mesh.part, missing))
    ground = np.isin(mesh.semantic, _GROUND)
    vertices = mesh.vertices.copy()
    flat = np.unique(mesh.faces[ground])
    low = vertices[:, :2].min(axis=0) - 5.0
    cells = (np.ceil(np.ptp(vertices[:, :2], axis=0) / 2.0) + 6).astype(int)
    shift = np.zeros_like(vertices)
    for axis, sigma in enumerate((EDGES_M, EDGES_M, HEIGHTS_M)):
        field = gaussian_filter(generator.normal(size=cells), ALIKE_M / 2.0 / 2)
        field *= sigma / field.std()
        shift[:, axis] = map_coordinates(field, ((vertices[:, :2] - low) / 2.0).T, order=1)
    vertices[flat] += shift[flat]
    others = ~ground
    for number in np.unique(mesh.part[others]):
        mine = np.unique(mesh.faces[others & (mesh.part == number)])
        sigma = HOUSES_M if number in houses else 0.2
        vertices[mine, :2] += generator.normal(0, sigma, 2)
    return LabelledMesh(vertices, mesh.faces, mesh.semantic, mesh.material, mesh.part)


def _of_kind(
    mesh: LabelledMesh, kind: str, scans: Scans, generator: np.random.Generator
) -> LabelledMesh:
    """Return what of a mesh a kind of map has."""
    ground = np.isin(mesh.semantic, _GROUND)
    if kind == "side":
        away = mesh.triangles().mean(axis=1) - scans.true.translation
        ahead = scans.true.rotation[:, 0]
        return mesh.select(ground | (ahead[0] * away[:, 1] - ahead[1] * away[:, 0] > 0))
    if kind == "poles":
        mesh = mesh.select(ground | np.isin(mesh.semantic, semantic_id("pole")))
        ground = np.isin(mesh.semantic, _GROUND)
        plain = np.where(ground, semantic_id("terrain"), mesh.semantic).astype(np.uint16)
        return LabelledMesh(mesh.vertices, mesh.faces, plain, mesh.material, mesh.part)
    if kind == "all":
        return mesh
    parts = [mesh.select(ground)]
    for number, one in enumerate(scans.boxes if kind == "cars" else []):
        if one.semantic[0] == semantic_id("car"):  # a third will be missing, as of all things
            part = np.full_like(one.part, number + 1)
            parts.append(LabelledMesh(one.vertices, one.faces, one.semantic, one.material, part))
    return LabelledMesh.concatenate(parts)


def scanned(
    twin: Twin, sensor: tuple[str, float, bool], count: int, generator: np.random.Generator
) -> Scans:
    """Return frames in the sensor's frame, and where the sensor was."""
    model, height, beside = sensor
    lanes = [
        lane
        for lane in twin.roads.lanes
        if lane.road and "car" in lane.allowed and lane.length > 15
    ]
    rig = None
    while rig is None:
        line = np.asarray(lanes[generator.integers(len(lanes))].centre)
        k = generator.integers(1, len(line))
        along = line[k, :2] - line[k - 1, :2]
        place = line[k - 1, :2] + along * generator.random()
        if np.hypot(*place) > 60.0:
            continue
        along /= max(np.hypot(*along), 1e-6)
        if beside:
            place = place + np.array([along[1], -along[0]]) * 4.5
        spec = {
            "rate_hz": 10,
            "sensors": [
                {
                    "name": "a",
                    "model": model,
                    "east_m": float(place[0]),
                    "north_m": float(place[1]),
                    "height_m": height,
                    "heading_deg": float(90 - np.degrees(np.arctan2(along[1], along[0]))),
                    "pitch_deg": float(generator.normal(0, 1.0)),
                    "roll_deg": float(generator.normal(0, 1.0)),
                }
            ],
        }
        try:
            rig = place_rig(RigSpec.model_validate(spec), twin.mesh)
        except InputError:  # a pole would stand in a house
            continue
    boxes, frames = clutter(twin, generator), []
    for number in range(count):
        passing = clutter(twin, generator, 0.1) if count > 1 else []
        world = LabelledMesh.concatenate([twin.mesh, *boxes, *passing])
        found = Scanner(world, rig, 0, surface=twin.surface_materials).scan(number, [])
        frames.append(
            Frame(
                found.points[:, :3].astype(float),
                intensity=found.points[:, 3].astype(float),
                ring=found.ring.astype(np.int64),
            )
        )
    return Scans(frames, rig.sensors[0].site_SE3_sensor, boxes)


def guessed(case: Case, true: Pose, generator: np.random.Generator) -> Guess:
    """Return a guess that is as wrong as a case says."""
    yaw = np.degrees(np.arctan2(true.rotation[1, 0], true.rotation[0, 0]))
    far = generator.uniform(-0.9, 0.9, 3)
    most = 0.99 if case.guess == "edge" else 1.0 + 1.0 / case.within_m
    if case.guess != "inside":
        far[generator.integers(2)] = most * generator.choice([-1.0, 1.0])
    if case.guess == "edge":
        far[2] = 0.99 * generator.choice([-1.0, 1.0])
    east, north = true.translation[:2] + case.within_m * far[:2]
    turned = yaw + case.within_deg * far[2]
    return Guess(float(east), float(north), float(turned), case.within_m, case.within_deg)


def tried(case: Case, scans: Scans, map_: LabelledMesh, surface, generator) -> dict:
    """Align from a wrong guess; return what was stated and how far off it was."""
    true, guess = scans.true, guessed(case, scans.true, generator)
    row = dict(vars(case)) | {
        "true": true.translation.tolist(),
        "start": list(vars(guess).values()),
    }
    began = time.process_time()
    some, refused = [], []
    for frame in scans.frames:
        try:
            some.append(align(frame, map_, guess=guess, surface=surface))
        except InputError as error:
            refused.append(str(error))
    row["seconds"] = time.process_time() - began
    try:
        found = averaged(some) if len(some) >= len(refused) else None
    except InputError as error:
        found, refused = None, [str(error)]
    if found is None:
        places = np.array(re.findall(r"(-?[\d.]+) m E, (-?[\d.]+) m N", refused[0]), float)
        if len(places) == 2:
            row["nearest_m"] = float(np.hypot(*(places - true.translation[:2]).T).min())
        return row | {"refused": refused[0]}
    off = found.pose.translation - true.translation
    turn = found.pose.rotation @ true.rotation.T
    away = found.pose.translation[:2] - [guess.east_m, guess.north_m]
    return row | {
        "off_m": off.tolist(),
        "off_yaw_deg": float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))),
        "beyond_m": float(np.abs(away).max() - guess.within_m),
        "sigma_m": found.found.sigma_m.tolist(),
        "sigma_yaw_deg": float(found.found.sigma_deg[2]),
        "explained": found.found.explained,
        "curbs": found.found.curbs_explained,
        "marks": found.found.marks_explained,
        "confidence": found.confidence,
        "evidence": found.evidence,
    }


def wilson(held: int, of: int) -> tuple[float, float]:
    """Return the interval that holds a share in 95 of 100 cases (Wilson 1927)."""
    z = 1.959964
    middle = (held + z**2 / 2) / (of + z**2)
    half = z / (of + z**2) * np.sqrt(held * (of - held) / of + z**2 / 4)
    return float(max(middle - half, 0.0)), float(min(middle + half, 1.0))


def summary(rows: Sequence[dict]) -> str:
    """Return the tables: of poses that were accepted, and of two places that were told."""
    lines = [
        "| of | cases | accepted | off, median | off, most | place within 2 sd, both ways "
        "| height | heading |",
        "|---|---|---|---|---|---|---|---|",
    ]
    groups: dict[str, list[dict]] = {"all": list(rows)}
    for key in ("sensor", "map", "within_m", "guess", "frames", "site"):
        for value in sorted({row[key] for row in rows}, key=str):
            groups[f"{key} {value}"] = [row for row in rows if row[key] == value]
    for name, some in groups.items():
        good = [row for row in some if "off_m" in row]
        if not good:
            lines.append(f"| {name} | {len(some)} | 0 | | | | | |")
            continue
        off = np.abs([row["off_m"] for row in good])
        held = off <= 2 * np.array([row["sigma_m"] for row in good])
        plan = np.hypot(off[:, 0], off[:, 1])
        within = int(held[:, :2].all(axis=1).sum())
        low, high = wilson(within, len(good))
        turn = np.mean([abs(row["off_yaw_deg"]) <= 2 * row["sigma_yaw_deg"] for row in good])
        lines.append(
            f"| {name} | {len(some)} | {len(good)} | {np.median(plan):.2f} m | {plan.max():.2f} m "
            f"| {within / len(good):.0%} ({low:.0%} to {high:.0%}) | {held[:, 2].mean():.0%} "
            f"| {turn:.0%} |"
        )
    beyond = sum(row.get("beyond_m", -1.0) > 0 for row in rows)
    two = [row["nearest_m"] for row in rows if "nearest_m" in row and row["guess"] != "beyond"]
    lines += ["", f"accepted beyond the span: {beyond}"]
    lines.append(f"two places told: {len(two)}, one within 0.5 m: {np.sum(np.array(two) < 0.5)}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("twins", type=Path, nargs="+", help="folders of twins")
    parser.add_argument("--places", type=int, default=5, help="on each site, of a sensor each")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--maps", nargs="+", choices=sorted({*MAPS[0], *MAPS[1]}), help="all of these, none drawn"
    )
    parser.add_argument("--json", type=Path, help="a file for every case, a line each")
    given = parser.parse_args()
    rows = []
    for folder in given.twins:
        twin = load_twin(folder)
        site = folder.parent.name if folder.name == "twin" else folder.name
        for place in range(given.places):
            generator = np.random.default_rng([given.seed, place, *site.encode()])
            sensor = SENSORS[generator.integers(len(SENSORS))]
            frames = FRAMES if generator.random() < STANDS else 1
            scans = scanned(twin, sensor, frames, generator)
            for kinds in [(kind,) for kind in given.maps] if given.maps else MAPS:
                kind, guess = str(generator.choice(kinds)), str(generator.choice(GUESSES))
                span = SPANS[generator.integers(len(SPANS))]
                map_ = wrong_map(twin.mesh, kind, scans, generator)
                paint = kind != "poles" and generator.random() < 0.5
                surface = twin.surface_materials if paint else SurfaceMaterials()
                stands = f"{sensor[0]} on a {'pole' if sensor[2] else 'roof'}"
                case = Case(site, stands, kind, place, *span, guess, frames)
                rows.append(tried(case, scans, map_, surface, generator))
                print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
                if given.json:
                    with given.json.open("a") as file:
                        file.write(json.dumps(rows[-1]) + "\n")
    print(summary(rows))


if __name__ == "__main__":
    main()
