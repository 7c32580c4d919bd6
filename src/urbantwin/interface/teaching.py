"""Training a detector for one site: twin, drives, training, evaluation and model card."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Ge

from urbantwin.dataset.card.page import licences_told
from urbantwin.download import keys_allowed
from urbantwin.errors import InputError
from urbantwin.experiments.journal import Journal, step_key
from urbantwin.interface.command import command
from urbantwin.interface.evaluation_report import Evaluation
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, tell_line
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.twin import Twin, build_of, site_with_known_sensors
from urbantwin.interface.workbench import Workbench, estimated_s, minutes_text
from urbantwin.pages import card

if TYPE_CHECKING:
    from urbantwin.experiments.lessons import Lesson
    from urbantwin.site import Site

__all__ = ["Taught", "teach"]

#: Seconds of a drive before its first frame.
_START_S = 2.0
#: Largest accepted uncertainty of a rig's pose, metres and degrees.
_MOST_OFF = (5.0, 45.0)


@dataclass(frozen=True, eq=False, repr=False)
class Taught(Artefact):
    """A detector for one site, in a folder.

    Attributes:
        folder: folder with ``model/``, ``card.md``, the reports, and ``lessons/``.
        reports: evaluations by name.
        seconds: lower and upper estimate of the run time, seconds.
    """

    folder: Path
    reports: Mapping[str, Evaluation]
    seconds: tuple[float, float]

    def __fspath__(self) -> str:
        """Return the folder of the model: ``ut.model.detect(frames, model=taught)``."""
        return str(self.folder / "model")

    def __repr__(self) -> str:
        """Return the folder and the evaluations in short."""
        lines = [f"a detector ({self.folder})"]
        return "\n".join(lines + [f"{name}: {one.in_short}" for name, one in self.reports.items()])

    def summary(self) -> Summary:
        """Return the evaluations and the paths of the results."""
        return Summary(
            path=str(self.folder),
            reckoned_minutes=[round(one / 60, 1) for one in self.seconds],
            **(
                {
                    "model": str(self.folder / "model"),
                    "onnx": str(self.folder / "model" / "model.onnx"),
                    "card": str(self.folder / "card.md"),
                }
                if self.reports
                else {}
            ),
            judged={name: one.in_short for name, one in self.reports.items()},
        )


@command
def teach(
    site: AnyPath,
    out: AnyPath | None = None,
    *,
    minutes: Annotated[float, Ge(0.1)] = 30.0,
    steps: Annotated[int | None, Ge(1)] = None,
    drives: Annotated[int, Ge(1)] = 6,
    judging: Annotated[int, Ge(1)] = 2,
    seconds: Annotated[float, Ge(3)] = 200.0,
    every: Annotated[float, Ge(0.05)] = 4.0,
    real: Sequence[AnyPath] = (),
    background: Annotated[Sequence[str], "[NAME=]FILE"] = (),
    within: Annotated[tuple[float, float], "M DEG"] = (0.05, 0.3),
    seed: Annotated[int, Ge(0)] = 1,
    workers: Annotated[int | None, Ge(1)] = None,
    device: Annotated[str, "NAME"] = "cpu",
    plan: bool = False,
    key_env: Sequence[str] | None = None,
    allow_key: Sequence[str] | None = None,
    progress: ShowProgress = True,
) -> Taught:
    """Make a detector for the sensors of one place.

    The site's twin is built, and traffic is simulated several times with varied hour, demand,
    weather, light and seed, and with sensor poses varied within their uncertainty. A detector is
    trained on the recordings, and evaluated on drives of other seeds and hours, and on real frames
    if given.

    Args:
        site: the ``site.yaml``, with its rig.
        out: folder to write; ``detector`` beside the site if not given.
        minutes: minutes of training.
        steps: number of training steps; replaces ``minutes``.
        drives: number of drives to learn from.
        judging: number of drives to evaluate on.
        seconds: length of each drive, seconds.
        every: time between frames, seconds.
        real: labelled real frames to evaluate on as well.
        background: measured static world of real sensors, ``FILE`` or ``NAME=FILE``; used in two of
            three training drives and in all evaluation drives.
        within: uncertainty of the sensors' positions (metres) and angles (degrees).
        seed: random seed.
        workers: number of processes; every number gives the same bytes.
        device: device of PyTorch: ``cpu`` or ``cuda``.
        plan: only print the steps and the estimated time.
        key_env: environment variables that the site's file may use as keys, beside those whose
            names begin with ``URBANTWIN_``.
        allow_key: ``NAME=https://host``: variable, and the server that its key may be sent to.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the site, a file that it names, or real frames cannot be used, or torch is not
            installed.
        StageError: a stage failed.

    Example:
        $ urbantwin model teach mysite/site.yaml -o detector/ --plan
    """
    from urbantwin.learn.torch_device import check_torch

    check_torch(device)
    from urbantwin.artefact import check_file, replaced_file
    from urbantwin.experiments.lessons import lessons_of, moved_rig
    from urbantwin.learn import read_model

    _check(within, background)
    checked = site_with_known_sensors(Path(site))
    target = beside(Path(site), "detector") if out is None else Path(out)
    check_file(target / "card.md", kind="card")
    judges = _named(real)
    lessons = lessons_of(drives, judging, seed)
    frames = int((seconds - _START_S) / every) + 1
    estimated = estimated_s(
        twins=1,
        traffic_s=len(lessons) * seconds,
        frames=len(lessons) * frames * (1 + len(checked.rig.sensors)),
        judged=(judging + len(judges)) * frames,
        minutes=minutes,
        steps=steps,
    )
    tell_line(
        f"teach: {drives} drives of {seconds:g} s to learn from and {judging} to judge by, "
        f"{frames} frames each; {minutes_text(estimated)}",
        progress,
    )
    if plan:
        return Taught(target, {}, estimated)
    with keys_allowed(key_env, allow_key):
        journal = Journal(target)
        twin = _built(checked, journal, progress)
    bench = Workbench(journal, twin, workers, device, progress)
    began = time.monotonic()
    for number, lesson in enumerate(lessons):
        sees = list(background) if lesson.held or number % 3 != 2 else []
        # A measured background is valid only from the sensors' measured pose.
        rig = moved_rig(checked.rig, lesson, *((0.0, 0.0) if sees else within))
        motion = bench.motion(
            f"lessons/{lesson.name}-motion", seconds, lesson.seed, _traffic(lesson, twin)
        )
        bench.dataset(
            f"lessons/{lesson.name}", motion, rig, checked.rig_file, background=sees,
            seed=lesson.seed, start_s=_START_S, every=max(1, round(every * rig.rate_hz)),
        )  # fmt: skip
        if number == 0 and time.monotonic() - began > 1.0:
            left_s = (time.monotonic() - began) * (len(lessons) - 1)
            left_s += estimated_s(minutes=minutes, steps=steps)[1]
            tell_line(f"teach: by the first drive, about {left_s / 60:.0f} minutes to go", progress)
    teaching, held = (
        {one.name: target / "lessons" / one.name for one in lessons if one.held == judges_by}
        for judges_by in (False, True)
    )
    model = bench.model(
        "model",
        list(teaching.values()),
        classes=_classes_of(list(teaching.values())),
        seed=seed,
        steps=steps,
        minutes=None if steps else minutes,
    )
    reports = {
        name: bench.report(f"report-{name}", model, data) for name, data in (held | judges).items()
    }
    text = card(
        "interface/model_card.md.j2",
        site=checked.name,
        lessons=lessons,
        trained=read_model(model).trained,
        reports=reports,
        simulated=list(held),
        **licences_told(twin.manifest["inputs"]),
    )
    with replaced_file(target / "card.md", kind="card") as file:
        file.write_text(text, encoding="utf-8")
    return Taught(target, reports, estimated)


def _built(site: Site, journal: Journal, progress: ShowProgress) -> Twin:
    """Return the site's twin, built once."""
    from urbantwin.artefact import sha256_of

    place = "lessons/twin"
    key = step_key({"files": sorted(map(sha256_of, filter(Path.is_file, site.files())))})
    journal.once(place, key, partial(build_of, site, pictures=False, progress=progress))
    return Twin.open(journal.folder / place)


def _traffic(lesson: Lesson, twin: Twin) -> dict[str, Any]:
    """Return a lesson's changes to the traffic; counted traffic is not changed."""
    traffic: Mapping[str, Any] = twin.site["traffic"]
    if traffic.get("counts"):
        return {}
    usual = {name: float(rate) for name, rate in traffic["per_hour"].items()}
    return {"per_hour": lesson.per_hour(usual), "time_of_day": lesson.time_of_day}


def _check(within: tuple[float, float], background: Sequence[str]) -> None:
    """Check options early that would otherwise fail after the twin is built.

    Raises:
        InputError: a number is out of range, or a background is missing.
    """
    from urbantwin.lidar.background_file import named_background

    if not all(0 <= one <= most for one, most in zip(within, _MOST_OFF, strict=True)):
        raise InputError(
            f"is {within[0]:g} {within[1]:g}",
            place="--within",
            expected=f"0 to {_MOST_OFF[0]:g} m and 0 to {_MOST_OFF[1]:g} degrees",
        )
    for one in background:
        _, file = named_background(one)
        if not file.is_file():
            raise InputError("is not there", file=file, expected="a file of `background`")


def _named(real: Sequence[AnyPath]) -> dict[str, Path]:
    """Return real recordings by name.

    Raises:
        InputError: a recording has no labels.
    """
    from urbantwin.fidelity.readers import open_recording

    found: dict[str, Path] = {}
    for one in map(Path, real):
        recording = open_recording(one)
        if not any(recording.read(number).boxes is not None for number in range(len(recording))):
            raise InputError("has no boxes to judge by", file=one, expected="labelled frames")
        name = one.resolve().name
        found[name if name not in found else f"{name}-{len(found) + 1}"] = one
    return found


def _classes_of(datasets: Sequence[Path]) -> list[str]:
    """Return the classes with enough labelled points in some datasets.

    Raises:
        InputError: no class has an object with enough points.
    """
    from urbantwin.dataset.reading.objects import LabelledObjects
    from urbantwin.detections import DETECTED_CLASSES, detected_class
    from urbantwin.evaluation import FEWEST_POINTS

    seen: set[str] = set()
    for one in datasets:
        objects = LabelledObjects.in_folder(one)
        names = objects.class_name[objects.num_points >= FEWEST_POINTS]
        seen |= {str(detected_class(name)) for name in set(names.tolist())}
    found = [name for name in DETECTED_CLASSES if name in seen]
    if not found:
        raise InputError(
            "no frame has a labelled object", file=datasets[0], expected="traffic that the rig sees"
        )
    return found
