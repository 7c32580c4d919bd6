"""Studies of robustness: levels of faults times seeds, through recording, detection, tracking."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, read_json, replaced_folder
from urbantwin.errors import InputError
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.reckoning import FRAME_S, JUDGED_S, TRAFFIC_S, training_s
from urbantwin.interface.stage import ShowProgress, tell_line
from urbantwin.interface.study_course import Course, Judge, density_of, of_this_version
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.interface.twin import Twin
    from urbantwin.site import RigSpec
    from urbantwin.studies.robustness import StudyFile

__all__ = ["Study", "study"]

_KIND = "study"
_REPORT = "report"
#: Figures that are told on the console.
_TOLD = ("seen", "ap", "hota", "idf1")


@dataclass(frozen=True, repr=False)
class Study(Artefact):
    """What faults, weather and traffic do to what is seen, detected and followed.

    Attributes:
        folder: where it is; ``report/study.html`` in it is the page for people.
        manifest: ``report/study.json``; empty of a plan.
        seconds: the least and the most that it was reckoned to take.
        report: the folder of the report; ``report`` in the folder when not given.
    """

    folder: Path
    manifest: dict[str, Any]
    seconds: tuple[float, float] = (0.0, 0.0)
    report: Path | None = None

    @classmethod
    def open(cls, folder: AnyPath) -> Study:
        """Open a study's folder, or the report in it.

        Raises:
            InputError: it is none.
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
        """What every level does: a row for each factor, level, class and figure."""
        return self._table("effects")

    @property
    def cells(self) -> pa.Table:
        """What was measured: a row for each recording and class."""
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
                path=str(self.folder),
                reckoned_minutes=[round(low / 60, 1), round(high / 60, 1)],
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
    grid: AnyPath,
    out: AnyPath | None = None,
    *,
    plan: bool = False,
    workers: int | None = None,
    device: str = "cpu",
    progress: ShowProgress = True,
) -> Study:
    """Measure what faults, weather and traffic do; interrupted, the same call goes on.

    Every seed has one motion (one for each density of traffic), which is replayed under all other
    levels, so that they alone differ. What is done stays done, also where the grid changes.

    Args:
        grid: the study's file: twin, seeds, detector, factors with their levels.
        out: the folder to write; ``study`` beside the file when not given.
        plan: only say what would be done, and how long it takes.
        workers: processes to record with; every number gives the same bytes.
        device: of torch.
        progress: show how far it is; or a function that is told (share, doing), of each stage.

    Raises:
        InputError: the file or what it names cannot be used; no torch.
        StageError: the base of a seed failed, or the disk is full.

    Example:
        >>> ut.experiment.run("grid.yaml").effects.to_pandas()
    """
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin
    from urbantwin.studies.robustness import check_rigs, load_study, write_study
    from urbantwin.variation import traffic_of_density

    described = load_study(Path(grid))
    place = beside(described.file, "study", out)
    twin = Twin.open(described.twin)
    spec, rig_file = rig_spec_on(twin, described.rig)
    if not spec.fused:
        raise InputError(
            "leaves a dataset for each sensor", file=rig_file, expected="a rig with fused: true"
        )
    rigs = check_rigs(described, spec)
    for its in _each_once(rigs):  # before anything is driven
        placed(its, twin, rig_file)
    cells = described.cells()
    traffics = {
        density: traffic_of_density(
            twin.site["traffic"], density, f"factors.traffic_density of {described.file}"
        )
        for density in sorted({density_of(cell) for cell in cells})
    }
    if not _frames(described, spec.rate_hz):
        raise InputError(
            "leaves no frame", file=described.file, place="start", expected="more seconds"
        )
    doubts: list[str] = []
    if described.model is not None or described.train is not None:
        from urbantwin.learn.torch_device import check_torch

        check_torch(device)
        doubts = _detector_looks(described, rigs[0])
    check_folder(place / _REPORT, kind=_KIND, inputs=[described.file, twin.folder])
    reckoned = _reckoned(described, rigs, len(traffics))
    tell_line(_first_line(described, rigs, reckoned), progress)
    if plan:
        return Study(place, {}, reckoned)
    course = Course(described, twin, rig_file, place, traffics, workers, device, progress)
    model = course.model(rigs[0])
    found, failed = course.all_cells(cells, rigs, model)
    inputs = [described.file, twin.folder]
    with replaced_folder(place / _REPORT, kind=_KIND, inputs=inputs) as folder:
        told_of = _told(described, twin, rigs[0], model)
        manifest = write_study(
            folder,
            described,
            [one.measured for one in found],
            [one.objects for one in found],
            failed,
            told_of,
            doubts,
        )
    shutil.rmtree(place / "work", ignore_errors=True)
    return Study(place, manifest, reckoned)


def _in_lines(effects: Sequence[Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return a row for each level: what it does to figures that are shares, in points of a hundred.

    The whole table is in ``study.json``, ``effects.parquet`` and on the page.
    """
    lines: dict[str, dict[str, str]] = {}
    for row in effects:
        if row["figure"] in _TOLD:
            level = f"{row['factor']} = {row['level']}"
            words = f"{100 * row['difference']:+.1f}"
            if row["low"] is not None:
                words += f" ({100 * row['low']:+.1f} to {100 * row['high']:+.1f})"
            lines.setdefault(level, {"level": level})[row["figure"]] = words
    return list(lines.values())


def _each_once(rigs: Sequence[RigSpec]) -> list[RigSpec]:
    return list({one.model_dump_json(): one for one in rigs}.values())


def _detector_looks(described: StudyFile, rig: RigSpec) -> list[str]:
    """Return what is to be doubted of the detector, before anything is computed.

    Raises:
        InputError: the model cannot be read, tells no boxes, or does not know a class of the study.
    """
    if described.train is not None:
        reach = described.train.reach
    else:
        from urbantwin.learn import read_model

        assert described.model is not None
        design = read_model(described.model).design
        if not design.classes:
            raise InputError(
                "tells no boxes",
                file=described.model,
                expected="a model of `urbantwin model train`",
            )
        for name in described.classes or ():
            if name not in design.classes:
                raise InputError(
                    f"names {name}, which the model {described.model.name} does not detect",
                    file=described.file,
                    place="classes",
                    expected="some of " + ", ".join(design.classes),
                )
        reach = design.range_m
    if rig.label_range_m is not None and rig.label_range_m <= reach:
        return []
    until = "as far as sensors report" if rig.label_range_m is None else f"{rig.label_range_m:g} m"
    return [
        f"The detector looks {reach:g} m along x and y, objects count {until}: what stands farther "
        "is missed at every level. A smaller label_range_m of the rig leaves it out."
    ]


def _frames(described: StudyFile, rate_hz: float) -> int:
    # The last frame's turn ends with the motion.
    last = (described.seconds - described.start_s) * rate_hz - 1.0
    return max(0, int(last / described.every + 1e-6) + 1)


def _reckoned(described: StudyFile, rigs: Sequence[RigSpec], densities: int) -> tuple[float, float]:
    """Return the least and the most seconds that all of it is reckoned to take."""
    frames, sensors = _frames(described, rigs[0].rate_hz), len(rigs[0].sensors)
    how = described.train
    learning = 0 if how is None else len(how.seeds)
    detects = how is not None or described.model is not None
    ends = []
    for k in range(2):
        recorded_s = frames * (1 + sensors) * FRAME_S[k]
        judged_s = frames * JUDGED_S[k] * (1.0 if detects else 0.1)
        ends.append(
            (len(described.seeds) * densities + learning) * described.seconds * TRAFFIC_S[k]
            + learning * recorded_s
            + (0.0 if how is None else training_s(0.0, how.steps)[k])
            + len(described.seeds) * len(rigs) * (recorded_s + judged_s)
        )
    return ends[0], ends[1]


def _first_line(
    described: StudyFile, rigs: Sequence[RigSpec], reckoned: tuple[float, float]
) -> str:
    low, high = (round(one / 60) for one in reckoned)
    minutes = "less than a minute"
    if high > 0:
        span = f"{high}" if low == high else f"{max(low, 1)} to {high}" if high > 1 else "1"
        minutes = f"about {span} minute{'s' * (high != 1)}"
    frames = _frames(described, rigs[0].rate_hz)
    seeds, sensors = len(described.seeds), len(rigs[0].sensors)
    who = "nothing is detected"
    if described.train is not None:
        who = f"a detector of {described.train.steps} steps"
    elif described.model is not None:
        who = f"the detector {described.model.name}"
    return (
        f"study: {seeds} seed{'s' * (seeds != 1)} x {len(rigs)} cells = {seeds * len(rigs)} "
        f"recordings of {frames} frame{'s' * (frames != 1)} by {sensors} "
        f"sensor{'s' * (sensors != 1)}; {who}; {minutes} on two processors"
    )


def _told(described: StudyFile, twin: Twin, rig: RigSpec, judge: Judge | None) -> dict[str, Any]:
    """Return what ``study.json`` says of what it was made from."""
    trained = None if judge is None else dict(judge.model.trained)
    frames = _frames(described, rig.rate_hz)
    who = "nothing was detected"
    if trained is not None:
        who = f"a detector of {trained.get('steps', 'unknown')} steps"
    sensors = ", ".join(f"{one.name} ({one.model})" for one in rig.sensors)
    return {
        "study": described.file.stem,
        "how": (
            f"{len(described.seeds)} seeds, each one motion of {described.seconds:g} s on "
            f"{twin.site.get('name', 'a twin')} that all levels replay; {frames} frames by "
            f"{sensors}; {who}. Objects are those that count at the base level of the same seed."
        ),
        **of_this_version({"twin_sha256": twin.sha256}),
        "model": None if judge is None else {"sha256": judge.sha256, "trained": trained},
        "seconds": described.seconds,
        "start_s": described.start_s,
        "every": described.every,
    }
