"""Training a model on more examples of the objects that it misses."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import yaml
from annotated_types import Ge

from urbantwin.errors import InputError, StageError
from urbantwin.experiments.journal import Journal
from urbantwin.interface.command import command
from urbantwin.interface.evaluation_report import Evaluation
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, tell_line
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.twin import Twin
from urbantwin.interface.workbench import Workbench

if TYPE_CHECKING:
    from urbantwin.evaluation.worst import Case

    #: A missed object, and its position x, y in the site frame, metres.
    _Missed = tuple[Case, tuple[float, float]]

__all__ = ["Improved", "improve"]

#: Seconds of a drive before the first frame; seconds at both ends of a drive without events.
_START_S, _APART_S = 2.0, 3.0
#: A miss of the same class within this distance (m) of another counts as the same place.
_BESIDE_M = 3.0
#: Largest distance (m) from the place at which an inserted actor passes.
_NEAR_M = 30.0
_FIGURES = ("within_1_m", "within_2_m", "bev_iou_0.5", "iou_3d_0.5")


@dataclass(frozen=True, eq=False, repr=False)
class Improved(Artefact):
    """A model trained further, with its evaluations before and after.

    Attributes:
        folder: folder with ``model/``, ``improvement.md`` and the reports.
        missed: number of distinct missed objects by class.
        before: evaluations of the first model, by name.
        after: evaluations of the improved model on the same frames, by name.
    """

    folder: Path
    missed: Mapping[str, int]
    before: Mapping[str, Evaluation]
    after: Mapping[str, Evaluation]

    def __fspath__(self) -> str:
        """Return the folder of the model: ``ut.model.detect(frames, model=improved)``."""
        return str(self.folder / "model")

    def __repr__(self) -> str:
        """Return the folder and the evaluations in short."""
        lines = [f"a model that learned on ({self.folder})"]
        lines += [f"{name}: {one.in_short}" for name, one in self.after.items()]
        return "\n".join(lines)

    def summary(self) -> Summary:
        """Return the missed objects, and average precisions before and after, percent."""
        gained = {}
        for name, one in self.after.items():
            known = self.before[name].figures
            gained[name] = {
                label: {
                    figure: [_percent(known.get(label), figure), _percent(row, figure)]
                    for figure in _FIGURES
                }
                for label, row in one.figures.items()
                if row.get("objects")
            }
        return Summary(
            path=str(self.folder),
            model=str(self.folder / "model"),
            report=str(self.folder / "improvement.md"),
            missed=dict(self.missed),
            before_and_after=gained,
        )


@command
def improve(
    model: AnyPath,
    twin: AnyPath,
    out: AnyPath | None = None,
    *,
    rig: AnyPath | None = None,
    drives: Annotated[int, Ge(1)] = 2,
    events: Annotated[int, Ge(1)] = 20,
    seconds: Annotated[float, Ge(7)] = 120.0,
    every: Annotated[float, Ge(0.05)] = 2.0,
    minutes: Annotated[float, Ge(0.1)] = 10.0,
    steps: Annotated[int | None, Ge(1)] = None,
    also: Sequence[AnyPath] = (),
    real: Sequence[AnyPath] = (),
    seed: Annotated[int, Ge(0)] = 1,
    workers: Annotated[int | None, Ge(1)] = None,
    device: Annotated[str, "NAME"] = "cpu",
    progress: ShowProgress = True,
) -> Improved:
    """Find what a model misses, and train it on more of it.

    The model is run on a recorded drive. Actors of the missed classes are inserted at the same
    places of further drives, as events of a ``scenario.yaml``, and the model is trained on these.
    Another drive, with another seed and nothing inserted, evaluates it before and after. After an
    interruption, the same call continues.

    Args:
        model: folder that ``model train`` wrote.
        twin: twin's folder, with its rig.
        out: folder to write; ``improved`` beside the model if not given.
        rig: ``rig.yaml``; the twin's own rig if not given.
        drives: number of training drives with inserted actors.
        events: largest number of events per drive; an event that cannot be staged is left out.
        seconds: length of each drive, seconds.
        every: time between frames, seconds.
        minutes: minutes of training.
        steps: number of training steps; replaces ``minutes``.
        also: further datasets to learn from, against forgetting.
        real: labelled real frames to evaluate on as well.
        seed: random seed.
        workers: number of processes; every number gives the same bytes.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the model, the twin or frames cannot be used.
        StageError: a stage failed, or the model misses no object.

    Example:
        $ urbantwin model improve model/ urbantwin-demo/twin -o improved/
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin.artefact import check_file, replaced_file
    from urbantwin.learn import read_model

    source = Path(model)
    design = read_model(source).design
    if not design.classes:
        raise InputError("finds no boxes", file=source, expected="a model with a head for them")
    target = beside(source, "improved") if out is None else Path(out)
    check_file(target / "improvement.md", kind="improvement")
    bench = Workbench(Journal(target), Twin.open(twin), workers, device, progress)
    practice = _Practice(bench, None if rig is None else Path(rig), seconds, every)
    look, held = practice.drive("look", 2 * seed), practice.drive("held", 2 * seed + 1)
    detections = bench.detections("drives/look-detections", source, look)
    cases = _missed(detections, look, design.classes)
    if not cases:
        raise StageError(f"{source} misses no object in {look}: there is nothing to learn")
    counts = Counter(one.class_name for one, _ in cases)
    missed = {name: counts[name] for name in design.classes if counts[name]}
    words = ", ".join(f"{count} of {name}" for name, count in missed.items())
    tell_line(f"improve: missed on a drive of its own: {words}", progress)
    sources = [look]
    for number in range(drives):
        # Cases are distributed over the drives if there are enough.
        some = cases[number::drives] if len(cases) >= drives * events else cases
        sources.append(
            practice.drive(f"more-{number + 1}", 2 * (1000 * seed + number), some[:events])
        )
    better = bench.model(
        "model",
        [*sources, *map(Path, also)],
        source,
        classes=list(design.classes),
        seed=seed,
        reach=design.range_m,
        cell=design.cell_m,
        width=design.width,
        intensity=design.intensity,
        steps=steps,
        minutes=None if steps else minutes,
        heads=["boxes", "points"] if design.points else None,
    )
    judges = {"held": held} | {Path(one).resolve().name: Path(one) for one in real}
    before, after = (
        {name: bench.report(f"{when}-{name}", judged, data) for name, data in judges.items()}
        for when, judged in (("before", source), ("after", better))
    )
    made = Improved(target, missed, before, after)
    with replaced_file(target / "improvement.md", kind="improvement") as file:
        file.write_text(_text(made), encoding="utf-8")
    return made


@dataclass(frozen=True)
class _Practice:
    """Recorded drives of a twin, with its own rig or that of a file."""

    bench: Workbench
    rig: Path | None
    seconds: float
    every_s: float

    def drive(self, name: str, seed: int, put_in: Sequence[_Missed] = ()) -> Path:
        """Return the dataset of a drive, with actors inserted at the places of missed objects."""
        from urbantwin.interface.rig import rig_spec_on
        from urbantwin.site.rig_changes import RigChanges

        place = f"drives/{name}-motion"
        motion = self.bench.motion(f"{place}-bare" if put_in else place, self.seconds, seed, {})
        if put_in:
            twin = self.bench.twin
            make = partial(_put_in, twin, motion, put_in, self.seconds)
            missed = [(one.class_name, *at) for one, at in put_in]
            motion = self.bench.once(place, make, [twin.folder, motion], put_in=missed)
        spec, file = rig_spec_on(self.bench.twin, self.rig, RigChanges(fused=True))
        every = max(1, round(self.every_s * spec.rate_hz))
        return self.bench.dataset(
            f"drives/{name}", motion, spec, file, seed=seed, start_s=_START_S, every=every
        )


def _missed(detections: Path, data: Path, classes: Sequence[str]) -> list[_Missed]:
    """Return the objects that a model misses, alternating between classes, and their positions."""
    import numpy as np

    from urbantwin.detections import read_detections
    from urbantwin.evaluation import evaluate as judged
    from urbantwin.evaluation import read_labelled
    from urbantwin.evaluation.worst import worst_misses
    from urbantwin.fidelity.readers import open_recording

    recording = open_recording(data)
    seen = read_labelled(read_detections(detections), recording)
    figures = judged(seen, layout=recording.layout, classes=list(classes), draws=2)
    found: list[_Missed] = []
    for one in worst_misses(figures, len(seen.truth)):
        frame = recording.read(seen.number[one.frame])
        middle = one.box[None, :3]
        if frame.world_SE3_frame is not None:
            middle = frame.world_SE3_frame.apply(middle)
        x, y = float(middle[0, 0]), float(middle[0, 1])
        near = any(
            other.class_name == one.class_name and np.hypot(x - at[0], y - at[1]) < _BESIDE_M
            for other, at in found
        )
        if not near:
            found.append((one, (round(x, 2), round(y, 2))))
    return found


def _put_in(
    twin: Twin, plain: Path, cases: Sequence[_Missed], seconds: float, folder: Path
) -> None:
    """Insert actors at the places of missed objects into a motion, and write the scenario."""
    from urbantwin.traffic.events import with_events
    from urbantwin.traffic.events.scenario import Passage
    from urbantwin.traffic.motion import Motion

    motion = Motion.load(plain)
    step = (seconds - 2 * _APART_S) / len(cases)
    staged: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for number, (one, (x, y)) in enumerate(cases):
        event = {
            "event": "passage",
            "at_s": round(_APART_S + number * step, 1),
            "place": {"x": x, "y": y},
            "actor": one.class_name,
            "within_m": _NEAR_M,
        }
        try:
            motion = with_events(motion, twin, [(number, Passage.model_validate(event))], [])
        except (InputError, StageError):
            continue  # no actor of this class can pass there, or there is no room
        staged.append(event)
        rows += motion.manifest["events"]
    if not staged:
        raise StageError(f"none of {len(cases)} missed objects can be put into {folder}")
    replace(motion, manifest={**motion.manifest, "events": rows}).save(folder)
    text = yaml.safe_dump({"events": staged}, sort_keys=False)
    folder.with_name(f"{folder.name}-scenario.yaml").write_text(text, encoding="utf-8")


def _percent(row: Mapping[str, Any] | None, figure: str) -> float | None:
    value = None if row is None else row["ap"][figure]["ap"]
    return None if value is None else round(100 * value, 1)


def _text(made: Improved) -> str:
    """Return the report as Markdown: missed objects, and all figures before and after."""
    missed = ", ".join(f"{count} of {name}" for name, count in made.missed.items() if count)
    lines = [
        "# What a model learned from what it missed",
        "",
        f"Missed on a drive of the twin: {missed} (different objects, places "
        f"{_BESIDE_M:g} m apart). They were put into further drives, `drives/*-scenario.yaml`.",
        "",
        "Average precision in per cent, before -> after; in brackets the middle 95 % of draws of "
        "frames.",
    ]
    for name, one in made.after.items():
        kind = "a drive with a seed of its own" if name == "held" else "real frames"
        lines += [
            "",
            f"## {name} ({kind}, {one.manifest['frames']} frames)",
            "",
            "| class | objects | within 1 m | within 2 m | BEV IoU 0.5 | 3D IoU 0.5 |",
            "|---|---|---|---|---|---|",
        ]
        for label, row in one.figures.items():
            if row.get("objects"):
                before = made.before[name].figures.get(label)
                cells = " | ".join(
                    f"{_told(before, figure)} -> {_told(row, figure)}" for figure in _FIGURES
                )
                lines.append(f"| {label} | {row['objects']} | {cells} |")
    return "\n".join(lines) + "\n"


def _told(row: Mapping[str, Any] | None, figure: str) -> str:
    value = _percent(row, figure)
    if row is None or value is None:
        return "-"
    ends = row["ap"][figure].get("ap_ci95") or ()
    sure = " to ".join("-" if one is None else f"{100 * one:.0f}" for one in ends)
    return f"{value:.0f} ({sure})" if sure else f"{value:.0f}"
