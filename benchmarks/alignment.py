"""How often what `urbantwin align` states is so: many sites, sensors, starts and wrong maps.

A street is a twin with parked cars and hedges that no map has. It is scanned from a car's roof and
from poles, and aligned with a map of it that is wrong as maps are: edges and heights by smooth
errors, houses by 0.35 m, every third pole and tree missing; or of which only the ground is there.
The truth is known. Printed is how many poses were accepted, how far off these were, and how many
lay within twice the standard deviation that was stated.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from urbantwin.errors import InputError
from urbantwin.fidelity.alignment import Guess, align
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import LabelledMesh, Pose, SurfaceMaterials
from urbantwin.lidar import place_rig
from urbantwin.lidar.scanner import Scanner
from urbantwin.site.rig import RigSpec
from urbantwin.taxonomy import GROUND_CLASSES, material_id, semantic_id
from urbantwin.twin import Twin, load_twin

#: A sensor, how high above the ground, and whether it stands beside the street.
SENSORS = (("VLP-32C", 1.9, False), ("HDL-64E S3", 1.8, False), ("OS1-128", 5.5, True))
#: How wrong a map is, standard deviations in metres: edges in plan and heights over 15 m, houses.
EDGES_M, HEIGHTS_M, HOUSES_M, ALIKE_M = 0.12, 0.05, 0.35, 15.0
#: How far off the guess may be: metres and degrees.
SPANS = ((0.5, 2.0), (3.0, 15.0))
_GROUND = [semantic_id(name) for name in GROUND_CLASSES]


@dataclass(frozen=True)
class Case:
    """One frame, one map, one guess."""

    site: str
    sensor: str
    map: str
    place: int
    within_m: float
    within_deg: float


def clutter(twin: Twin, generator: np.random.Generator) -> LabelledMesh:
    """Return parked cars and hedges beside the lanes, as boxes."""
    parts = []
    for lane in twin.roads.lanes:
        if not lane.road or "car" not in lane.allowed:
            continue
        line = np.asarray(lane.centre)
        for k in range(1, len(line)):
            if generator.random() > 0.25:
                continue
            along = line[k, :2] - line[k - 1, :2]
            length = np.hypot(*along)
            if length < 4.0:
                continue
            along /= length
            aside = np.array([along[1], -along[0]]) * generator.choice([2.2, 3.5, 5.5])
            middle = line[k - 1, :2] + along * generator.uniform(0, length) + aside
            low = generator.random() < 0.7
            size = np.array([4.4, 1.8, 1.5]) if low else np.array([8.0, 0.8, 1.3])
            pose = Pose.from_ypr(
                [*middle, line[k, 2] + size[2] / 2 + 0.1], np.arctan2(*along[::-1])
            )
            parts.append(box(size, low).transformed(pose))
    return LabelledMesh.concatenate(parts)


def box(size: np.ndarray, car: bool) -> LabelledMesh:
    corners = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]) * size / 2
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [part for a, b, c, d in sides for part in ((a, b, c), (a, c, d))]
    kind = ("car", "metal-painted") if car else ("vegetation", "foliage")
    return LabelledMesh.build(corners, faces, semantic_id(kind[0]), material_id(kind[1]))


def wrong_map(mesh: LabelledMesh, kind: str, generator: np.random.Generator) -> LabelledMesh:
    """Return a mesh as a map would have it."""
    ground = np.isin(mesh.semantic, _GROUND)
    part = mesh.part[~ground]
    numbers = np.unique(part)
    building = np.isin(mesh.semantic, semantic_id("building"))
    houses = np.unique(mesh.part[building])
    missing = numbers[generator.random(len(numbers)) < 1 / 3]
    missing = np.setdiff1d(missing, houses)
    kept = ground | ((kind != "ground") & ~np.isin(mesh.part, missing))
    mesh = mesh.select(kept)
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


def scanned(
    twin: Twin, sensor: tuple[str, float, bool], generator: np.random.Generator
) -> tuple[Frame, Pose]:
    """Return a frame in the sensor's frame, and where the sensor was."""
    model, height, beside = sensor
    lanes = [
        lane
        for lane in twin.roads.lanes
        if lane.road and "car" in lane.allowed and lane.length > 15
    ]
    inside = []
    for lane in lanes:
        line = np.asarray(lane.centre)
        middle = line[len(line) // 2, :2]
        if np.hypot(*middle) < 60.0:
            inside.append((line, np.hypot(*middle)))
    world = None
    while world is None:
        line, _ = inside[generator.integers(len(inside))]
        k = generator.integers(1, len(line))
        along = line[k, :2] - line[k - 1, :2]
        along /= max(np.hypot(*along), 1e-6)
        place = line[k - 1, :2] + (line[k, :2] - line[k - 1, :2]) * generator.random()
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
        world = LabelledMesh.concatenate([twin.mesh, clutter(twin, generator)])
    found = Scanner(world, rig, 0, surface=twin.surface_materials).scan(0, [])
    frame = Frame(
        found.points[:, :3].astype(float),
        intensity=found.points[:, 3].astype(float),
        ring=found.ring.astype(np.int64),
    )
    return frame, rig.sensors[0].site_SE3_sensor


def tried(case: Case, frame: Frame, true: Pose, map_: LabelledMesh, surface, generator) -> dict:
    """Align from a wrong guess; return what was stated and how far off it was."""
    yaw = np.degrees(np.arctan2(true.rotation[1, 0], true.rotation[0, 0]))
    angle, far = generator.uniform(0, 2 * np.pi), case.within_m * generator.uniform(0.3, 0.9)
    guess = Guess(
        float(true.translation[0] + far * np.cos(angle)),
        float(true.translation[1] + far * np.sin(angle)),
        float(yaw + generator.uniform(-0.9, 0.9) * case.within_deg),
        case.within_m,
        case.within_deg,
    )
    row = dict(vars(case))
    began = time.perf_counter()
    try:
        found = align(frame, map_, guess=guess, surface=surface)
    except InputError as error:
        row |= {"refused": str(error), "seconds": time.perf_counter() - began}
        return row
    off = found.pose.translation - true.translation
    turn = found.pose.rotation @ true.rotation.T
    row |= {
        "off_m": off.tolist(),
        "off_yaw_deg": float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))),
        "sigma_m": found.found.sigma_m.tolist(),
        "sigma_yaw_deg": float(found.found.sigma_deg[2]),
        "explained": found.found.explained,
        "curbs": found.found.curbs_explained,
        "marks": found.found.marks_explained,
        "confidence": found.confidence,
        "evidence": found.evidence,
        "seconds": time.perf_counter() - began,
    }
    return row


def summary(rows: list[dict]) -> str:
    """Return the table, by site, map and span."""
    lines = [
        "| of | cases | accepted | off, median | off, most | within 2 sd | heading within 2 sd |"
    ]
    lines.append("|---|---|---|---|---|---|---|")
    groups: dict[str, list[dict]] = {"all": rows}
    for key in ("site", "sensor", "map", "within_m"):
        for value in sorted({row[key] for row in rows}, key=str):
            groups[f"{key} {value}"] = [row for row in rows if row[key] == value]
    for name, some in groups.items():
        good = [row for row in some if "off_m" in row]
        if not good:
            lines.append(f"| {name} | {len(some)} | 0 | | | | |")
            continue
        off = np.array([row["off_m"] for row in good])
        sigma = np.array([row["sigma_m"] for row in good])
        plan = np.hypot(off[:, 0], off[:, 1])
        within = (np.abs(off[:, :2]) <= 2 * sigma[:, :2]).all(axis=1)
        turn = np.array([abs(row["off_yaw_deg"]) <= 2 * row["sigma_yaw_deg"] for row in good])
        lines.append(
            f"| {name} | {len(some)} | {len(good)} | {np.median(plan):.2f} m | {plan.max():.2f} m "
            f"| {within.mean():.0%} | {turn.mean():.0%} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("twins", type=Path, nargs="+", help="folders of twins")
    parser.add_argument("--places", type=int, default=2, help="of each sensor on each site")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--within", type=float, choices=[near for near, _ in SPANS], help="guesses so far off alone"
    )
    parser.add_argument("--json", type=Path, help="a file for every case, a line each")
    given = parser.parse_args()
    rows = []
    for folder in given.twins:
        twin = load_twin(folder)
        site = folder.parent.name if folder.name == "twin" else folder.name
        for number, sensor in enumerate(SENSORS):
            for place in range(given.places):
                generator = np.random.default_rng([given.seed, number, place, *site.encode()])
                frame, true = scanned(twin, sensor, generator)
                for kind in ("all", "ground"):
                    map_ = wrong_map(twin.mesh, kind, generator)
                    paint = generator.random() < 0.5
                    surface = twin.surface_materials if paint else SurfaceMaterials()
                    for within in SPANS:
                        if given.within not in {None, within[0]}:
                            continue
                        case = Case(site, sensor[0], kind, place, *within)
                        rows.append(tried(case, frame, true, map_, surface, generator))
                        print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
                        if given.json:
                            with given.json.open("a") as file:
                                file.write(json.dumps(rows[-1]) + "\n")
    print(summary(rows))


if __name__ == "__main__":
    main()
