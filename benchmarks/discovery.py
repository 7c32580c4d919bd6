"""What `urbantwin rig discover` finds: in real recordings, and in made ones of known sensors.

A made rig is two sensors of the catalogue drawn by a seed, tilted by up to 12 degrees, in a street
of planes and boxes. Its units are as their models, or each channel is off by 0.1 degrees, or the
beams of the upper and the lower half leave 9 cm apart as well, as those of an HDL-64E do, or all
channels look up by 0.3 degrees as well. Printed is how far places and tilts are off, in metres,
degrees and the standard deviations stated.

    python benchmarks/discovery.py made --rigs 6
    python benchmarks/discovery.py real FRAME.bin FOLDER ...
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from urbantwin.errors import InputError
from urbantwin.fidelity.discovery import Discovery, FoundSensor, discover
from urbantwin.fidelity.readers import open_recording
from urbantwin.fidelity.sampling import evenly
from urbantwin.geometry import rotation_from_ypr
from urbantwin.lidar import sensor

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "fidelity"))
from closed_form_street import scan

MODELS = ("VLP-16", "HDL-32E", "PandarXT-32", "OS0-64", "VLP-32C", "Pandar64", "OS1-128")
#: Standard deviation of channels and an offset of all, degrees, and half the distance of lenses,
#: metres.
UNITS = {
    "as its model": (0.0, 0.0, 0.0),
    "0.1 degrees off": (0.1, 0.0, 0.0),
    "two lenses": (0.1, 0.0, 0.045),
    "0.3 degrees up": (0.1, 0.3, 0.0),
}
FRAMES = 12


def found_in(path: Path) -> Discovery:
    """Return the sensors of a recording."""
    recording = open_recording(path)
    used = evenly(len(recording), FRAMES)
    frames = [recording.read(number).points for number in used]
    return discover(frames, [recording.names[number] for number in used])


def real(paths: list[Path]) -> None:
    """Print a row of each sensor found in each recording."""
    print("| recording | model | x, y, z, m | tilt, deg | off its model, deg | on rings |")
    print("|---|---|---|---|---|---|")
    for path in paths:
        try:
            found = found_in(path)
        except InputError as error:
            print(f"| {path.name} | refused: {error.problem} | | | | |", flush=True)
            continue
        for one in found.sensors:
            place = ", ".join(f"{value:.3f}" for value in one.place)
            tilt = np.degrees(one.fit.seen_from.tilt)
            models = " or ".join(one.models) or "unknown"
            print(
                f"| {path.name} | {models} | {place} | {tilt:.2f} | {one.off_model_deg:.2f} "
                f"| {found.on_rings:.1%} |",
                flush=True,
            )


def made(
    units: list[str], rigs: int, seed: int
) -> Iterator[tuple[str, str, FoundSensor | None, np.ndarray, float]]:
    """Yield kind of unit, true model, the sensor found nearest, its errors of place and tilt."""
    for kind in units:
        channel_deg, all_deg, lens_m = UNITS[kind]
        for number in range(rigs):
            random = np.random.default_rng([seed, number])
            parts, truth = [], []
            for side in (-1.0, 1.0):
                model = sensor(str(random.choice(MODELS)))
                off = random.normal(0, 1, model.channels) * channel_deg + all_deg
                unit = replace(model, elevation_deg=model.elevation_deg + off)
                upper = model.elevation_deg > np.median(model.elevation_deg)
                place = np.array([side * random.uniform(5, 10), *random.uniform([-8, 2], [8, 5])])
                tilt, way = random.uniform(0, 12), random.uniform(0, 2 * np.pi)
                angles = (random.uniform(-180, 180), tilt * np.cos(way), tilt * np.sin(way))
                columns = min(model.columns, 1200)
                above = np.where(upper, lens_m, -lens_m)
                points, _ = scan(unit, place, angles, columns, random, origin_offset_m=above)
                parts.append(points)
                truth.append((model.name, place, rotation_from_ypr(*np.radians(angles))[:, 2]))
            try:
                sensors = discover([np.concatenate(parts)], ["0"]).sensors
            except InputError:
                sensors = ()
            for name, place, axis in truth:
                near = min(sensors, key=lambda s: np.linalg.norm(s.place - place), default=None)
                if near is None or np.linalg.norm(near.place - place) > 1.0:
                    yield kind, name, None, np.full(3, np.nan), np.nan
                    continue
                sine = np.linalg.norm(np.cross(axis, near.fit.seen_from.axis))
                yield kind, name, near, near.place - place, float(np.degrees(np.arcsin(sine)))


def main() -> None:
    """Print the table asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", nargs="?", choices=("made", "real"), default="made")
    parser.add_argument("paths", nargs="*", type=Path)
    parser.add_argument("--unit", choices=UNITS, action="append")
    parser.add_argument("--rigs", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    if asked.what == "real":
        real(asked.paths)
        return
    print("| unit | model | found | off x, y, z, m | deviations | tilt off, deg | deviations |")
    print("|---|---|---|---|---|---|---|")
    for kind, name, one, off, tilt in made(asked.unit or [*UNITS], asked.rigs, asked.seed):
        if one is None:
            print(f"| {kind} | {name} | missed | | | | |", flush=True)
            continue
        models, sigmas = " or ".join(one.models) or "unknown", off / one.sigma_m
        print(
            f"| {kind} | {name} | {models} | {', '.join(f'{v:+.4f}' for v in off)} "
            f"| {', '.join(f'{v:+.1f}' for v in sigmas)} "
            f"| {tilt:.4f} | {tilt / one.sigma_tilt_deg:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
