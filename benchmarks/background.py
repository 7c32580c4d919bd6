"""What a measured background does to every measure of ``compare``, where the truth is known.

The real world is a twin with parked cars. What is known of it, the twin that is compared, lacks
those cars and its trees, poles, fences and signs; a third of its buildings are a third lower and
another third stand 0.6 m off. Other traffic drives in each. Frames of the real sensor's first
minute make the background, later ones are compared with the twin recorded as it is, with the
background in place of its scene, and with both fused. How well what moves is found without labels
comes with it.

    python benchmarks/background.py out/twin
    python benchmarks/background.py out/twin --frames 20 --json --keep work/
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from urbantwin.artefact import sha256_of
from urbantwin.dataset import record
from urbantwin.fidelity import compare
from urbantwin.fidelity.background_estimation import measure_recording
from urbantwin.fidelity.background_subtraction import Background
from urbantwin.fidelity.beam_assignment import beams_of_rig
from urbantwin.fidelity.readers import open_recording
from urbantwin.geometry import LabelledMesh, Pose
from urbantwin.lidar import Rig, place_rig
from urbantwin.lidar.measured_file import rig_with_backgrounds
from urbantwin.site import load_rig_spec
from urbantwin.taxonomy import material_id, semantic_id
from urbantwin.traffic import Motion, run_traffic
from urbantwin.traffic.assets import asset_mesh
from urbantwin.twin import Twin, load_twin

LACKING = ("vegetation", "trunk", "pole", "fence", "traffic-sign", "other-object")
LOWER, MOVED_M = 2 / 3, 0.6
PARKED, FROM_M, TO_M, CLEAR_M = 12, 8.0, 45.0, 3.0
TRAINING_S, RATE_HZ = 60.0, 2.0
KINDS = ("plain", "background", "fused")


def with_mesh(twin: Twin, mesh: LabelledMesh, folder: Path) -> Twin:
    """A copy of a twin with another scene."""
    shutil.copytree(twin.folder, folder)
    mesh.save(folder / "scene.npz")
    manifest = json.loads((folder / "twin.json").read_text())
    manifest["files"]["scene.npz"] = sha256_of(folder / "scene.npz")
    (folder / "twin.json").write_text(json.dumps(manifest))
    return load_twin(folder)


def as_known(mesh: LabelledMesh) -> LabelledMesh:
    """What the twin knows of the real scene."""
    kept = mesh.select(~np.isin(mesh.semantic, [semantic_id(name) for name in LACKING]))
    vertices = kept.vertices.copy()
    building = kept.semantic == semantic_id("building")
    for number in np.unique(kept.part[building]).tolist():
        mine = np.unique(kept.faces[building & (kept.part == number)])
        if number % 3 == 0:
            ground = vertices[mine, 2].min()
            vertices[mine, 2] = ground + LOWER * (vertices[mine, 2] - ground)
        elif number % 3 == 1:
            vertices[mine, :2] += MOVED_M * np.array([0.6, 0.8])
    return replace(kept, vertices=vertices)


def parked(mesh: LabelledMesh, rig: Rig, driven: np.ndarray) -> list[LabelledMesh]:
    """Cars beside the carriageway, where nobody drives."""
    generator = np.random.default_rng(3)
    sensor = rig.sensors[0].site_SE3_sensor.translation[:2]
    beside = np.isin(mesh.semantic, [semantic_id(name) for name in ("sidewalk", "parking")])
    places = mesh.vertices[mesh.faces[beside]].mean(axis=1)
    away = np.linalg.norm(places[:, :2] - sensor, axis=1)
    places = generator.permutation(places[(away > FROM_M) & (away < TO_M)])
    cars: list[LabelledMesh] = []
    taken = driven
    for place in places:
        if len(cars) == PARKED:
            break
        if np.linalg.norm(taken - place[:2], axis=1).min() < CLEAR_M:
            continue
        taken = np.concatenate([taken, np.repeat(place[None, :2], 3, axis=0)])
        pose = Pose.from_ypr(place, float(generator.uniform(0, 2 * np.pi)))
        car = asset_mesh("car-sedan", 0)
        body = LabelledMesh.build(
            pose.apply(car.vertices),
            car.faces,
            semantic_id("other-structure"),
            material_id("metal-painted"),
        )
        cars.append(replace(body, material=car.material))
    return cars


def moved_to(motion: Motion, twin: Twin) -> Motion:
    """A motion on a twin with the same roads."""
    manifest = {**motion.manifest, "twin_sha256": twin.sha256}
    return Motion(manifest, motion.actors, motion.signals, motion.meshes)


def foreground_found(dataset: Path, first_s: float) -> list[dict[str, Any]]:
    """How much of what labels call an actor is found without them: of all, and of those that move.

    Actors that move go 3 m or more in the frames that the background is made of.
    """
    recording = open_recording(dataset)
    frames = [recording.read(number) for number in range(len(recording))]
    found = []
    for seconds, count in ((10, 20), (20, 20), (first_s, 20), (first_s, 60)):
        span = frames[: round(seconds * RATE_HZ)]
        used = [
            span[i] for i in np.unique(np.linspace(0, len(span) - 1, count).round().astype(int))
        ]
        model = Background(used)
        seen: dict[int, list[np.ndarray]] = {}
        for frame in span:
            for box, track in zip(frame.boxes.box, frame.boxes.track.tolist(), strict=True):
                seen.setdefault(track, []).append(box[:2])
        moving = [one for one, way in seen.items() if np.ptp(np.array(way), axis=0).max() > 3]
        hit = actors = of_moving = hit_moving = called = 0
        for frame in span[1::7]:
            told, true = model.foreground(frame), frame.instance > 0
            drives = np.isin(frame.instance, moving)
            hit, actors, called = (
                hit + (told & true).sum(),
                actors + true.sum(),
                called + told.sum(),
            )
            hit_moving, of_moving = hit_moving + (told & drives).sum(), of_moving + drives.sum()
        found.append(
            {
                "seconds": seconds,
                "frames": len(used),
                "moving_share": float(of_moving / actors),
                "found": float(hit / actors),
                "found_of_moving": float(hit_moving / of_moving),
                "right": float(hit / called),
            }
        )
    return found


def measure(
    twin_folder: Path, work: Path, frames: int, seconds: float, workers: int
) -> dict[str, Any]:
    """Make both worlds, record and compare."""
    known = load_twin(twin_folder)
    spec = load_rig_spec(known.rig_path, known.frame).model_copy(update={"rate_hz": RATE_HZ})
    traffic = [run_traffic(known, work / f"motion_{n}", seconds=seconds, seed=n) for n in (11, 12)]
    driven = np.concatenate(
        [np.column_stack([one.actors["x"], one.actors["y"]]) for one in traffic]
    )
    rig = place_rig(spec, known.mesh)
    cars = parked(known.mesh, rig, np.unique(np.round(driven), axis=0))
    real = with_mesh(known, LabelledMesh.concatenate([known.mesh, *cars]), work / "real_twin")
    twin = with_mesh(known, as_known(known.mesh), work / "twin")
    record(
        real,
        moved_to(traffic[0], real),
        rig,
        work / "training",
        workers=workers,
        seed=1,
        stop_s=TRAINING_S,
    )
    later = {"start_s": seconds - frames / RATE_HZ, "workers": workers}
    record(real, moved_to(traffic[0], real), rig, work / "real", seed=1, **later)
    summary = measure_recording(work / "training", beams_of_rig(rig), work / "measured.npz")
    result: dict[str, Any] = {"background": summary, "parked": len(cars), "measures": {}}
    for kind in KINDS:
        given = [] if kind == "plain" else [str(work / "measured.npz")]
        mine = rig_with_backgrounds(rig, given, fused=kind == "fused")
        record(twin, moved_to(traffic[1], twin), mine, work / kind, seed=2, **later)
        pair = (work / "real", work / kind, work / f"report_{kind}")
        report = compare(*pair, arbitrary=None, workers=workers)
        result["measures"][kind] = report.as_json()
    result["foreground"] = foreground_found(work / "training", TRAINING_S)
    return result


def table(measures: dict[str, Any]) -> list[tuple[str, list[float | None]]]:
    """Rows of measures: of each kind, and of real against real."""
    rows = []
    for part in ("whole", "background", "foreground"):
        found = {
            kind: one if part == "whole" else one["parts"][part] for kind, one in measures.items()
        }
        real = found["plain"]["anchors"]["real_against_real"]
        for name in found["plain"]["aggregate"]:
            values = [found[kind]["aggregate"].get(name) for kind in KINDS]
            values.append(real.get(name))
            rows.append((f"{part} {name}", [one and one["mean"] for one in values]))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("twin", type=Path, help="a twin's folder, as urbantwin demo writes one")
    parser.add_argument("--frames", type=int, default=20, help="pairs that are compared")
    parser.add_argument("--seconds", type=float, default=120.0, help="of traffic")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=Path, help="a new folder for all that is made")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.seconds < TRAINING_S + given.frames / RATE_HZ:
        sys.exit("too short: a minute for the background and the frames that are compared")
    with tempfile.TemporaryDirectory() as scratch:
        work = given.keep or Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        result = measure(given.twin, work, given.frames, given.seconds, given.workers)
    if given.json:
        print(json.dumps(result, indent=2))
        return
    print(json.dumps(result["background"]))
    print(f"{'':48}" + "".join(f"{kind:>12}" for kind in (*KINDS, "real")))
    for name, values in table(result["measures"]):
        cells = "".join(f"{'-' if value is None else format(value, '.4g'):>12}" for value in values)
        print(f"{name:48}{cells}")
    for row in result["foreground"]:
        print(json.dumps(row))


if __name__ == "__main__":
    main()
