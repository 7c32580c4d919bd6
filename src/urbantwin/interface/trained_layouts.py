"""Layouts of a placement judged by a detector: recorded, trained, evaluated and tracked."""

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

#: A class with fewer labelled boxes does not count in the mean.
_FEWEST_BOXES = 20
#: The training traffic has the seed of the motion and so much more.
_OTHER_SEED = 7919
#: What is told of a layout, as means over classes.
_KEYS = ("ap", "ap_low", "ap_high", "hota", "mota", "idf1")


@dataclass(frozen=True)
class LayoutTraining:
    """How layouts are judged by a detector.

    Attributes:
        steps: of the common detector, which learns from all layouts' recordings.
        width: multiple of the channels of the network.
        cell_m: edge of its pillars, metres.
        reach_m: how far it looks from the middle of the sensors, metres.
        own_share: of its steps, a layout's own detector goes on from the common one.
        learn: about so many frames that a layout's detector learns from.
        judge: and that it is judged by.
        seed: of weights and samples.
        workers: processes that record.
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
        """Steps of a layout's own detector, which begins as the common one."""
        return max(1, round(self.own_share * self.steps))


def shortlist(front: Sequence[int], count: int) -> list[int]:
    """Return so many layouts, evenly spread over a front from the cheapest to the dearest."""
    count = min(count, len(front))
    chosen = [front[round(k * (len(front) - 1) / max(count - 1, 1))] for k in range(count)]
    return list(dict.fromkeys(chosen))


def training_words(layouts: int, how: LayoutTraining) -> str:
    """Return how long it takes to train, in words."""
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
    """Judge layouts by detectors.

    All learn from one other motion (the twin's own traffic with another seed), and are judged by
    the motion that the layouts were searched with. A detector is first trained on the recordings of
    all layouts together, so that what differs is the layout and not the luck of its first weights;
    each layout's own goes on from there on its own recording. No box is left out for having few
    points or for being out of sight: what a layout does not see counts as missed. Tracking is that
    of what its sensors can see.

    Args:
        rigs: the ``rig.yaml`` of each layout, by its number.
        twin: the twin.
        motion: that judges.
        work: folder for what is made in between; what is there already is not made again.
        how: steps and sizes.
        tell: called with the share that is done and what is being done.

    Returns:
        A row for each layout: ``layout``, ``ap`` (mean over the learned classes that all layouts
        have), ``ap_low``, ``ap_high`` (mean of the classes' 95 % intervals), ``hota``, ``mota``,
        ``idf1``, and AP by class.

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
    """How layouts are recorded, trained and judged; what is finished is not made again."""

    bench: Workbench
    motion: Motion
    how: LayoutTraining

    @property
    def seconds(self) -> float:
        """Length of the motions, seconds."""
        return float(self.motion.times()[-1])

    def recorded(self, place: str, rig: Path, on: Motion | Path, frames: int) -> Path:
        """Return about so many frames of a layout, evenly spread over a motion."""
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
        """Return a detector."""
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
            second_look=False,  # layouts are compared: what is alike for all need not be learned
            part="all",
        )

    def judged(
        self, number: int, classes: Sequence[str], model: Path, data: Path
    ) -> dict[str, dict[str, float | None]]:
        """Return what a detector finds in a recording, judged by its labels."""
        from urbantwin.interface.tracked_objects import track

        found = self.bench.detections(f"found-{number}", model, data)
        follow = partial(track, found, frames=data, progress=False)
        followed = self.bench.once(f"tracked-{number}", follow, [found, data])
        present = _present(data)
        learned = Counter({name: present[name] for name in classes})
        return _by_class(_figures(found, data), _figures(followed, data), learned)


def _learned_classes(datasets: Sequence[Path]) -> tuple[str, ...]:
    """Return the classes that every recording has boxes of with points on them, to learn from."""
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
    """Judge detections by the labels of a recording; no box is left out for its few points."""
    from urbantwin.detections.forms import read_any_form
    from urbantwin.evaluation import evaluate, read_labelled
    from urbantwin.interface.parts import recording_of_part

    recording = recording_of_part(data, None, "all")
    said, _ = read_any_form(detections, lambda: recording)
    seen = read_labelled(said, recording, fewest_points=0)
    return evaluate(seen, layout=recording.layout)


def _present(data: Path) -> Counter[str]:
    """Return how many boxes of each class a recording has in the region, seen by a sensor or not.

    They are the same for every layout.
    """
    from urbantwin.interface.dataset import Dataset

    boxes = Dataset.open(data).boxes
    rows = zip(boxes["class"].to_pylist(), boxes["ignored"].to_pylist(), strict=True)
    return Counter(name for name, ignored in rows if ignored != "outside")


def _by_class(
    figures: Figures, of_tracks: Figures, present: Counter[str]
) -> dict[str, dict[str, float | None]]:
    """Return precision and tracking of each class that is learned and has enough boxes.

    `evaluate` leaves out what no sensor can see, which would favour layouts that see little. Such
    a box is missed, so recall, and with it the area under precision, is that of the boxes that
    count times the share that they are of all.
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
    """Return a row for each layout: means over the classes that every layout has boxes of."""
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
