"""Evaluation of sensor layouts by detectors: recorded, trained, evaluated and tracked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from urbantwin.experiments.journal import Journal
from urbantwin.interface.motion import Motion
from urbantwin.interface.workbench import Workbench, estimated_s, minutes_text
from urbantwin.progress import Progress, between, untold

if TYPE_CHECKING:
    from urbantwin.evaluation.evaluate import Figures
    from urbantwin.interface.twin import Twin

__all__ = ["LayoutTraining", "shortlist", "trained_layouts", "training_words"]

#: Fewest labelled boxes of a class that counts in the mean.
_FEWEST_BOXES = 20
#: Offset of the training traffic's seed from that of the motion.
_OTHER_SEED = 7919
#: Figures reported of a layout, as means over classes.
_KEYS = ("ap", "ap_low", "ap_high", "hota", "mota", "idf1")


@dataclass(frozen=True)
class LayoutTraining:
    """Settings of the evaluation of layouts by detectors.

    Attributes:
        steps: steps of the common detector, which learns from the recordings of all layouts.
        width: multiple of the channels of the network.
        cell_m: edge of a pillar, metres.
        reach_m: range from the centre of the sensors, metres.
        own_share: steps of a layout's own detector, as a fraction of the common detector's.
        learn: approximate number of training frames per layout.
        judge: approximate number of evaluation frames per layout.
        seed: random seed of weights and samples.
        workers: number of recording processes.
    """

    steps: int
    width: float = 0.5
    cell_m: float = 0.4
    reach_m: float = 60.0
    own_share: float = 0.25
    learn: int = 80
    judge: int = 60
    seed: int = 0
    workers: int = 1

    @property
    def own_steps(self) -> int:
        """Training steps of a layout's own detector, which starts from the common one."""
        return max(1, round(self.own_share * self.steps))


def shortlist(front: Sequence[int], count: int) -> list[int]:
    """Return ``count`` layouts, evenly spread over a front from the lowest to the highest cost."""
    count = min(count, len(front))
    chosen = [front[round(k * (len(front) - 1) / max(count - 1, 1))] for k in range(count)]
    return list(dict.fromkeys(chosen))


def training_words(layouts: int, how: LayoutTraining) -> str:
    """Return the estimated training time, in words."""
    steps = how.steps + layouts * how.own_steps
    took_s = estimated_s(
        frames=layouts * (how.learn + how.judge),
        judged=layouts * how.judge,
        steps=steps * how.width,
    )
    return (
        f"{layouts} layouts recorded twice, {how.steps} steps on all and {how.own_steps} on each: "
        f"{minutes_text(took_s)}"
    )


def trained_layouts(
    rigs: Mapping[int, Path],
    twin: Twin,
    motion: Motion,
    work: Path,
    how: LayoutTraining,
    tell: Progress | None = None,
) -> list[dict[str, Any]]:
    """Evaluate layouts by detectors.

    All learn from one other motion (the twin's own traffic with another seed), and are evaluated on
    the motion that the layouts were searched with. A common detector is first trained on the
    recordings of all layouts, so that differences come from the layout and not from random initial
    weights. Each layout's own detector continues from it on that layout's recording. No box is
    excluded for having few points or being occluded: what a layout does not see counts as missed.
    Tracking is evaluated on what its sensors can see.

    Args:
        rigs: ``rig.yaml`` of each layout, by layout number.
        twin: the twin.
        motion: motion for evaluation.
        work: folder of intermediate results; existing ones are reused.
        how: steps and sizes.
        tell: called with the fraction done and a description.

    Returns:
        A row per layout: ``layout``, ``ap`` (mean over the learned classes that all layouts have),
        ``ap_low``, ``ap_high`` (mean of the classes' 95 % intervals), ``hota``, ``mota``, ``idf1``,
        and AP by class.

    Raises:
        InputError: torch is not installed.
        StageError: SUMO failed, a worker was killed, the disk is full, or the recordings have too
            few boxes.
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch("cpu")
    show = tell or untold
    show(0.0, "the traffic to learn from")
    bench = Workbench(Journal(work), twin, how.workers, progress=False)
    course = _Course(bench, motion, how)
    other = int(motion.manifest["seed"]) + _OTHER_SEED
    learning = bench.motion("motion", course.seconds, other, {})
    learned: dict[int, Path] = {}
    for k, number in enumerate(rigs):
        show(0.05 + 0.2 * k / len(rigs), f"layout {number}: recording what is learned from")
        learned[number] = course.recorded(f"learn-{number}", rigs[number], learning, how.learn)
    several = list(learned.values())
    classes = _learned_classes(several)
    train = partial(course.trained, classes)
    common = train("common", several, how.steps, between(show, 0.25, 0.5, "all layouts"))
    found: dict[int, dict[str, dict[str, float | None]]] = {}
    for k, number in enumerate(rigs):
        share = 0.5 / len(rigs)
        part = between(show, 0.5 + share * k, 0.5 + share * (k + 1), f"layout {number}")
        telling = between(part, 0.0, 0.5, "training")
        own = train(f"model-{number}", [learned[number]], how.own_steps, telling, common)
        part(0.5, "recording what judges")
        judge = course.recorded(f"judge-{number}", rigs[number], motion, how.judge)
        part(0.6, "detecting and judging")
        found[number] = course.judged(number, classes, own, judge)
    show(1.0, "done")
    return _rows(found)


@dataclass(frozen=True, eq=False)
class _Course:
    """Records, trains and evaluates layouts; finished results are reused."""

    bench: Workbench
    motion: Motion
    how: LayoutTraining

    @property
    def seconds(self) -> float:
        """Length of the motions, seconds."""
        return float(self.motion.times()[-1])

    def recorded(self, place: str, rig: Path, on: Motion | Path, frames: int) -> Path:
        """Return a recording of a layout with about ``frames`` frames, evenly spread in time."""
        from urbantwin.interface.rig import rig_spec_on

        spec, file = rig_spec_on(self.bench.twin, rig)
        every = max(1, round(self.seconds * spec.rate_hz / frames))
        return self.bench.dataset(place, on, spec, file, every=every)

    def trained(
        self,
        classes: Sequence[str],
        place: str,
        datasets: Sequence[Path],
        steps: int,
        tell: Progress,
        weights: Path | None = None,
    ) -> Path:
        """Return the folder of a trained detector."""
        return replace(self.bench, progress=tell).model(
            place,
            datasets,
            weights,
            steps=steps,
            classes=list(classes),
            reach=self.how.reach_m,
            cell=self.how.cell_m,
            width=self.how.width,
            batch=2,
            seed=self.how.seed,
            second_look=False,  # layouts are compared; it would be the same for all
            part="all",
        )

    def judged(
        self, number: int, classes: Sequence[str], model: Path, data: Path
    ) -> dict[str, dict[str, float | None]]:
        """Return figures by class of a detector's detections in a recording."""
        from urbantwin.interface.tracked_objects import track

        found = self.bench.detections(f"found-{number}", model, data)
        follow = partial(track, found, frames=data, progress=False)
        followed = self.bench.once(f"tracked-{number}", follow, [found, data])
        present = _present(data)
        learned = Counter({name: present[name] for name in classes})
        return _by_class(_figures(found, data), _figures(followed, data), learned)


def _learned_classes(datasets: Sequence[Path]) -> tuple[str, ...]:
    """Return the classes of which every recording has enough boxes with points.

    Raises:
        StageError: there is no such class.
    """
    from urbantwin.detections import DETECTED_CLASSES
    from urbantwin.errors import StageError
    from urbantwin.interface.dataset import Dataset

    counts = [
        Dataset.open(one).manifest["counts"].get("boxes_in_reach_with_points", {})
        for one in datasets
    ]
    found = tuple(
        name
        for name in DETECTED_CLASSES
        if all(one.get(name, 0) >= _FEWEST_BOXES for one in counts)
    )
    if not found:
        raise StageError(
            f"no class has {_FEWEST_BOXES} boxes with points in the recording of every layout: "
            "there is nothing to train with; a longer motion, or fewer layouts"
        )
    return found


def _figures(detections: Path, data: Path) -> Figures:
    """Evaluate detections against a recording's labels, including boxes with few points."""
    from urbantwin.detections.forms import read_any_form
    from urbantwin.evaluation import evaluate, read_labelled
    from urbantwin.interface.parts import recording_of_part

    recording = recording_of_part(data, None, "all")
    said, _ = read_any_form(detections, lambda: recording)
    seen = read_labelled(said, recording, fewest_points=0)
    return evaluate(seen, layout=recording.layout)


def _present(data: Path) -> Counter[str]:
    """Return the number of boxes by class inside the region, seen by a sensor or not.

    The numbers are the same for every layout.
    """
    from urbantwin.interface.dataset import Dataset

    boxes = Dataset.open(data).boxes
    rows = zip(boxes["class"].to_pylist(), boxes["ignored"].to_pylist(), strict=True)
    return Counter(name for name, ignored in rows if ignored != "outside")


def _by_class(
    figures: Figures, of_tracks: Figures, present: Counter[str]
) -> dict[str, dict[str, float | None]]:
    """Return precision and tracking of each learned class with enough boxes.

    `evaluate` excludes boxes that no sensor can see, which would favour layouts that see little.
    Such a box counts as missed here: recall, and with it the area under precision, is scaled by the
    share of boxes that count.
    """
    from urbantwin.evaluation.criterion import near
    from urbantwin.evaluation.tracks import judged_tracks

    followed = judged_tracks(of_tracks) or {}
    found: dict[str, dict[str, float | None]] = {}
    for name, one in figures.classes.items():
        if name == "large" or present[name] < _FEWEST_BOXES:
            continue
        precision = one.figures["ap"][near(name).name]
        share = min(1.0, one.figures["objects"] / present[name])
        low, high = precision["ap_ci95"] or (None, None)
        tracks = {key: followed.get(name, {}).get(key) for key in ("hota", "mota", "idf1")}
        ends = {"ap": precision["ap"], "ap_low": low, "ap_high": high}
        scaled = {key: None if one is None else share * one for key, one in ends.items()}
        found[name] = scaled | tracks
    return found


def _rows(found: Mapping[int, Mapping[str, Mapping[str, float | None]]]) -> list[dict[str, Any]]:
    """Return a row per layout: means over the classes that all layouts have."""
    classes = [name for name in next(iter(found.values()), {})
               if all(name in one for one in found.values())]  # fmt: skip
    return [
        {
            "layout": number,
            **{key: _mean([one[name][key] for name in classes]) for key in _KEYS},
            "ap_by_class": {name: one[name]["ap"] for name in one},
        }
        for number, one in found.items()
    ]


def _mean(values: Sequence[float | None]) -> float | None:
    known = [one for one in values if one is not None]
    return round(float(np.mean(known)), 6) if known else None
