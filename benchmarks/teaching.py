"""Small trials of what teaches a detector, seed by seed: notebook/learning.md.

    python benchmarks/teaching.py pretraining WORK DATASET ...   # plain, masked, next-sweep
    python benchmarks/teaching.py curriculum WORK EASIEST ... HARDEST
    python benchmarks/teaching.py frames WORK DATASET ...        # an eighth, a quarter, a half, all
    python benchmarks/teaching.py sites WORK DATASET ...         # the first, the first two, ...
    python benchmarks/teaching.py realism WORK NAME ...          # recordings of realism.py
    python benchmarks/teaching.py SUBJECT WORK DATASET ... --table

Of DATASET@4 every fourth frame is taken. Detectors of cars learn from simulated frames alone, by
the functions behind `train` and `pretrain`; frames are levelled once for all of them. All arms of
a subject see as many windows, those of a pre-training counted. Labels of KITTI's and LUMPI's frames
judge and do nothing else. What is done is not done again. All arms of a seed come before the next
seed, so that an interrupted trial has whole pairs.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

import realism
import urbantwin as ut
from learning import LUMPI, REAL
from urbantwin.artefact import replaced_folder
from urbantwin.fidelity.readers import open_recording
from urbantwin.learn import (
    Design,
    LabelledFrames,
    Model,
    Recipe,
    digest_of,
    labelled_frames,
    pretrained,
    trained,
    unlabelled_frames,
    write_model,
)
from urbantwin.learn.frames import write_level_frame
from urbantwin.learn.pretraining import TASKS
from urbantwin.progress import untold

#: Steps of an arm, and how many of them a pre-training takes.
STEPS, BEFORE = 400, 133
DESIGN = Design(classes=("car",), range_m=44.0)
RECIPE = Recipe(steps=STEPS, batch=2, window_m=32.0)
WITHIN_M = 40.0
JUDGES = {"KITTI": REAL / "recordings" / "kitti-training", "LUMPI": LUMPI}
MEASURES = ("within_2_m", "bev_iou_0.5")
SUBJECTS = ("pretraining", "curriculum", "frames", "sites", "realism")


@dataclass(frozen=True)
class Arm:
    """What one detector learns from, and how: datasets, of each every so many-th frame."""

    name: str
    datasets: tuple[tuple[Path, int], ...]
    before: str | None = None
    in_order: bool = False


def arms_of(subject: str, given: Sequence[str], work: Path) -> list[Arm]:
    """Return what is compared; the first is what the others are compared with."""
    if subject == "realism":
        return [
            Arm(name, tuple((one, 1) for one in realism.datasets(work, name)))
            for name in ("all", *given)
        ]
    parts = [one.partition("@") for one in given]
    datasets = tuple((Path(path).absolute(), int(every or 1)) for path, _, every in parts)
    if subject == "pretraining":
        return [Arm("plain", datasets), *(Arm(task, datasets, before=task) for task in TASKS)]
    if subject == "curriculum":
        return [Arm("shuffled", datasets), Arm("in order", datasets, in_order=True)]
    if subject == "frames":
        return [
            Arm(f"1 of {more}", tuple((one, every * more) for one, every in datasets))
            for more in (1, 2, 4, 8)
        ]
    counts = range(len(datasets), 0, -1)
    return [Arm(f"{count} of the datasets", datasets[:count]) for count in counts]


def levelled(work: Path, arm: Arm) -> LabelledFrames:
    """Return the frames of an arm on level ground, which are made once."""
    names = [set(open_recording(one).names[::every]) for one, every in arm.datasets]
    key = "-".join(f"{one.parent.name}.{one.name}.{every}" for one, every in arm.datasets)
    paths = [one for one, _ in arm.datasets]
    return labelled_frames(paths, DESIGN, work / "levelled" / key, untold, names=names)


def without_labels(frames: LabelledFrames, arm: Arm) -> LabelledFrames:
    """Return the same frames as they are without a label; for the next sweep, all that have one."""
    if arm.before == "next-sweep":
        folder = frames.folder.with_name(f"{frames.folder.name}-followed")
        paths = [one for one, _ in arm.datasets]
        return unlabelled_frames(paths, DESIGN, folder, untold, following=True)
    folder = frames.folder.with_name(f"{frames.folder.name}-without-labels")
    folder.mkdir(exist_ok=True)
    for number in range(len(frames)):
        one = frames.frame(number)
        bare = replace(one, box=one.box[:0], number=one.number[:0])
        write_level_frame(folder / f"{number:06}.npz", bare)
    return LabelledFrames(folder, frames.rigs, (), {})


def learned(work: Path, place: Path, arm: Arm, seed: int) -> None:
    """Let one detector learn."""
    if (place / "model").exists():
        return
    place.mkdir(parents=True, exist_ok=True)
    recipe = replace(RECIPE, seed=seed, in_order=arm.in_order)
    frames, start = levelled(work, arm), None
    began = time.process_time()
    if arm.before is not None:
        first, bare = replace(recipe, steps=BEFORE), replace(DESIGN, classes=())
        seen = without_labels(frames, arm)
        state = place / "before.safetensors"
        network, *_ = pretrained(seen, bare, first, state, untold, arm.before)
        start, recipe = network.state_dict(), replace(recipe, steps=STEPS - BEFORE)
    state = place / "state.safetensors"
    network, steps, loss = trained(frames, DESIGN, recipe, state, untold, start)
    told = {"steps": steps, "before": arm.before, "seed": seed, "loss": loss}
    told |= {"frames": len(frames), "objects": frames.objects[0]}
    told |= {"datasets": [{"name": one.name, "sha256": digest_of(one)} for one, _ in arm.datasets]}
    told |= {"processor_s": time.process_time() - began}
    with replaced_folder(place / "model", kind="model", inputs=[]) as scratch:
        write_model(scratch, Model(DESIGN, network, told))
    print(place, told, flush=True)


def judged(place: Path) -> None:
    """Judge it by real frames."""
    for name, data in JUDGES.items():
        if not (place / name).exists():
            ut.model.evaluate(place / "model", data, place / name, classes=["car"], within=WITHIN_M,
                        progress=False)  # fmt: skip


def table(work: Path, arms: Sequence[str], seeds: int) -> None:
    """Print the figures of all detectors, and how far each is from the first with its seed."""
    heads = [f"{name}: {measure}" for name in JUDGES for measure in MEASURES]
    print("| | seed |", " | ".join(heads), "|\n|", "---|" * (2 + len(heads)))
    found: dict[str, dict[int, list[float]]] = {}
    for arm in arms:
        for seed in range(1, seeds + 1):
            rows = []
            for name in JUDGES:
                file = work / arm.replace(" ", "-") / str(seed) / name / "evaluation.json"
                if file.exists():
                    car = json.loads(file.read_text())["classes"]["car"]["ap"]
                    rows += [(car[one]["ap"], car[one]["ap_ci95"]) for one in MEASURES]
            if len(rows) < len(heads):
                continue
            found.setdefault(arm, {})[seed] = [100 * ap for ap, _ in rows]
            cells = [
                f"{100 * ap:.0f} ({' to '.join(f'{100 * one:.0f}' for one in ends or ())})"
                for ap, ends in rows
            ]
            print("|", arm, "|", seed, "|", " | ".join(cells), "|")
    for arm, of_seed in list(found.items())[1:]:
        both = sorted(set(of_seed) & set(found[arms[0]]))
        if not both:
            continue
        off = np.array([np.subtract(of_seed[k], found[arms[0]][k]) for k in both])
        cells = [f"{one.mean():+.1f} ({', '.join(f'{x:+.0f}' for x in one)})" for one in off.T]
        print("|", f"{arm} against {arms[0]}", "|", "all |", " | ".join(cells), "|")


def main() -> None:
    """Do what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("subject", choices=SUBJECTS)
    parser.add_argument("work", type=Path)
    parser.add_argument("given", nargs="*", metavar="DATASET", help="or a recording of realism.py")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--arm", action="append", metavar="NAME", help="this one alone")
    parser.add_argument("--table", action="store_true", help="print what is there")
    given = parser.parse_args()
    torch.set_num_threads(1)
    work = given.work.resolve()
    place = work / "teaching" / given.subject
    arms = arms_of(given.subject, given.given, work)
    for seed in range(1, given.seeds + 1) if not given.table else ():
        for arm in arms:
            if given.arm is None or arm.name in given.arm:
                one = place / arm.name.replace(" ", "-") / str(seed)
                learned(work / "teaching", one, arm, seed)
                judged(one)
    table(place, [arm.name for arm in arms], given.seeds)


if __name__ == "__main__":
    main()
