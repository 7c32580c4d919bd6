"""Robustness studies: fault levels times seeds, through recording, detection and tracking."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin import __version__
from urbantwin.artefact import check_folder, read_json, replaced_folder
from urbantwin.errors import InputError
from urbantwin.experiments.journal import Journal
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, tell_line
from urbantwin.interface.study_course import Detector, StudyCourse, density_of
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.workbench import Workbench, estimated_s, minutes_text

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.experiments.study.file import StudyFile
    from urbantwin.interface.twin import Twin
    from urbantwin.site import RigSpec

__all__ = ["Study", "study"]

_KIND = "study"
_REPORT = "report"
#: Figures shown in the summary.
_SUMMED_UP = ("seen", "ap", "hota", "idf1")


@dataclass(frozen=True, repr=False)
class Study(Artefact):
    """Effects of faults, weather and traffic on visibility, detection and tracking.

    Attributes:
        folder: the study's folder; ``report/study.html`` in it is the report page.
        manifest: content of ``report/study.json``; empty for a plan.
        seconds: lower and upper estimate of the run time, seconds.
        report: folder of the report; ``report`` in the folder if not given.
    """

    folder: Path
    manifest: dict[str, Any]
    seconds: tuple[float, float] = (0.0, 0.0)
    report: Path | None = None

    @classmethod
    def open(cls, folder: AnyPath) -> Study:
        """Open a study's folder, or the report in it.

        Raises:
            InputError: the folder is not a study.
        """
        place = Path(folder)
        inside = place if (place / f"{_KIND}.json").is_file() else place / _REPORT
        manifest = read_json(inside / f"{_KIND}.json", kind=_KIND)
        return cls(place, manifest, report=inside)

    def __repr__(self) -> str:
        """Return the headline and the folder."""
        return f"{self.manifest.get('in_short', 'a plan')} ({self.folder})"

    @property
    def effects(self) -> pa.Table:
        """Effect of every level: a row per factor, level, class and figure."""
        return self._table("effects")

    @property
    def cells(self) -> pa.Table:
        """Measured figures: a row per recording and class."""
        return self._table("cells")

    def _table(self, name: str) -> pa.Table:
        from urbantwin.artefact.tables import read_parquet

        place = self.report or self.folder / _REPORT
        return read_parquet(place / f"{name}.parquet", f"{name} of a study")

    def summary(self) -> Summary:
        """Return the headline, doubts, and the differences of the mean over classes."""
        if not self.manifest:
            low, high = self.seconds
            return Summary(
                path=str(self.folder), reckoned_minutes=[round(low / 60, 1), round(high / 60, 1)]
            )
        told = self.manifest
        return Summary(
            path=str(self.folder),
            page=str((self.report or self.folder / _REPORT) / "study.html"),
            in_short=told["in_short"],
            doubts=told["doubts"],
            recordings=told["recordings"],
            failed=[f"seed {one['seed']}, {one['cell']}: {one['why']}" for one in told["failed"]],
            effects=_in_lines(told["effects"]),
        )


def study(
    grid: Path,
    out: AnyPath | None = None,
    *,
    plan: bool = False,
    workers: int | None = None,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> Study:
    """Measure effects of faults, weather and traffic; see `experiment.run`.

    Every seed has one motion per traffic density, which is replayed under all other levels, so that
    only the levels differ.

    Raises:
        InputError: the file or a file that it names cannot be used, or torch is not installed.
        StageError: the base of a seed failed, or the disk is full.
    """
    from urbantwin.experiments.ladder import traffic_of_density
    from urbantwin.experiments.study.file import StudyFile, check_rigs
    from urbantwin.experiments.study.report import write_study
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin

    file = StudyFile.read(grid)
    place = beside(file.file, "study", out)
    twin = Twin.open(file.twin)
    spec, rig_file = rig_spec_on(twin, file.rig)
    if not spec.fused:
        raise InputError(
            "leaves a dataset for each sensor", file=rig_file, expected="a rig with fused: true"
        )
    rigs = check_rigs(file, spec)
    for rig in {one.model_dump_json(): one for one in rigs}.values():  # check before simulating
        placed(rig, twin, rig_file)
    asked_at = f"factors.traffic_density of {file.file}"
    traffics = {
        density: traffic_of_density(twin.site["traffic"], density, asked_at)
        for density in sorted({density_of(cell) for cell in file.cells()})
    }
    if not _frames(file, spec.rate_hz):
        raise InputError("leaves no frame", file=file.file, place="start", expected="more seconds")
    doubts: list[str] = []
    if file.model is not None or file.train is not None:
        from urbantwin.learn.torch_device import check_torch

        check_torch(device)
        doubts = _check_detector(file, rigs[0])
    inputs = [file.file, twin.folder]
    check_folder(place / _REPORT, kind=_KIND, inputs=inputs)
    seconds = _estimate(file, rigs, len(traffics))
    tell_line(_first_line(file, rigs, seconds), progress)
    if plan:
        return Study(place, {}, seconds)
    bench = Workbench(Journal(place), twin, workers, device, progress)
    course = StudyCourse(file, rig_file, traffics, bench)
    course.detector = course.detector_of(rigs[0])
    measured, failed = course.cells(rigs)
    with replaced_folder(place / _REPORT, kind=_KIND, inputs=inputs) as folder:
        made_from = _made_from(file, twin, rigs[0], course.detector)
        manifest = write_study(folder, file, measured, failed, made_from, doubts)
    shutil.rmtree(place / "work", ignore_errors=True)
    return Study(place, manifest, seconds)


def _check_detector(file: StudyFile, rig: RigSpec) -> list[str]:
    """Return doubts about the detector, before anything is computed.

    Raises:
        InputError: the model cannot be read, detects no boxes, or lacks a class of the study.
    """
    if file.train is not None:
        reach = file.train.reach
    else:
        from urbantwin.learn import read_model

        assert file.model is not None
        design = read_model(file.model).design
        if not design.classes:
            expected = "a model of `urbantwin model train`"
            raise InputError("has no output of boxes", file=file.model, expected=expected)
        for name in file.classes or ():
            if name not in design.classes:
                raise InputError(
                    f"names {name}, which the model {file.model.name} does not detect",
                    file=file.file, place="classes",
                    expected="some of " + ", ".join(design.classes),
                )  # fmt: skip
        reach = design.range_m
    if rig.label_range_m is not None and rig.label_range_m <= reach:
        return []
    until = "as far as sensors report" if rig.label_range_m is None else f"{rig.label_range_m:g} m"
    return [
        f"The detector looks {reach:g} m along x and y, objects count {until}: what stands farther "
        "is missed at every level. A smaller label_range_m of the rig leaves it out."
    ]


def _frames(file: StudyFile, rate_hz: float) -> int:
    # The last frame's turn must end within the motion.
    last = (file.seconds - file.start) * rate_hz - 1.0
    return max(0, int(last / file.every + 1e-6) + 1)


def _estimate(file: StudyFile, rigs: Sequence[RigSpec], densities: int) -> tuple[float, float]:
    """Return the lower and upper estimate of the run time, seconds."""
    frames, sensors, how = _frames(file, rigs[0].rate_hz), len(rigs[0].sensors), file.train
    recordings, learning = len(file.seeds) * len(rigs), 0 if how is None else len(how.seeds)
    judging = 1.0 if how is not None or file.model is not None else 0.1
    return estimated_s(
        traffic_s=(len(file.seeds) * densities + learning) * file.seconds,
        frames=(recordings + learning) * frames * (1 + sensors),
        judged=recordings * frames * judging,
        steps=0 if how is None else how.steps,
    )


def _first_line(file: StudyFile, rigs: Sequence[RigSpec], seconds: tuple[float, float]) -> str:
    detector = "nothing is detected"
    if file.train is not None:
        detector = f"a detector of {file.train.steps} steps"
    elif file.model is not None:
        detector = f"the detector {file.model.name}"
    counts = {"seed": len(file.seeds), "frame": _frames(file, rigs[0].rate_hz)}
    counts["sensor"] = len(rigs[0].sensors)
    seeds, frames, sensors = (f"{n} {name}{'s' * (n != 1)}" for name, n in counts.items())
    return (
        f"study: {seeds} x {len(rigs)} cells = {len(file.seeds) * len(rigs)} recordings of "
        f"{frames} by {sensors}; {detector}; {minutes_text(seconds)}"
    )


def _made_from(
    file: StudyFile, twin: Twin, rig: RigSpec, detector: Detector | None
) -> dict[str, Any]:
    """Return the provenance entries of ``study.json``."""
    words, model = "nothing was detected", None
    if detector is not None:
        trained = dict(detector.model.trained)
        words = f"a detector of {trained.get('steps', 'unknown')} steps"
        model = {"sha256": detector.sha256, "trained": trained}
    sensors = ", ".join(f"{one.name} ({one.model})" for one in rig.sensors)
    return {
        "study": file.file.stem,
        "how": (
            f"{len(file.seeds)} seeds, each one motion of {file.seconds:g} s on "
            f"{twin.site.get('name', 'a twin')} that all levels replay; "
            f"{_frames(file, rig.rate_hz)} frames by {sensors}; {words}. Objects are those that "
            "count at the base level of the same seed."
        ),
        "urbantwin": __version__,
        "twin_sha256": twin.sha256,
        "model": model,
        "seconds": file.seconds,
        "start_s": file.start,
        "every": file.every,
    }


def _in_lines(effects: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return a row per level: differences of figures that are shares, in percentage points.

    The whole table is in ``study.json``, ``effects.parquet`` and on the page.
    """
    lines: dict[str, dict[str, str]] = {}
    for row in effects:
        if row["figure"] in _SUMMED_UP:
            level = f"{row['factor']} = {row['level']}"
            words = f"{100 * row['difference']:+.1f}"
            if row["low"] is not None:
                words += f" ({100 * row['low']:+.1f} to {100 * row['high']:+.1f})"
            lines.setdefault(level, {"level": level})[row["figure"]] = words
    return list(lines.values())
