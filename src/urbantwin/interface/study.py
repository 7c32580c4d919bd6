"""Studies of robustness: levels of faults times seeds, through recording, detection, tracking."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, read_json, replaced_folder, sha256_of, write_json
from urbantwin.dataset.split import SplitAsked
from urbantwin.errors import InputError, StageError
from urbantwin.interface.dataset import Dataset, recorded
from urbantwin.interface.done_steps import DoneSteps
from urbantwin.interface.motion import Motion, driven
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.reckoning import FRAME_S, JUDGED_S, TRAFFIC_S, training_s
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.summary import Summary
from urbantwin.interface.trained_model import train
from urbantwin.progress import Progress, between

if TYPE_CHECKING:
    import pyarrow as pa

    from urbantwin.grid import Cell, Journal
    from urbantwin.interface.twin import Twin
    from urbantwin.learn import Model
    from urbantwin.site import RigSpec
    from urbantwin.study.robustness import Measured, StudyFile

__all__ = ["Study", "study"]

_KIND = "study"
#: Of a file of a cell: what is in it.
_CELL = "cell"


@dataclass(frozen=True, repr=False)
class Study:
    """What faults, weather and traffic do to what is seen, detected and followed.

    Attributes:
        folder: where it is; ``report/study.html`` in it is the page for people.
        manifest: ``report/study.json``; empty of a plan.
        seconds: the least and the most that it was reckoned to take.
    """

    folder: Path
    manifest: dict[str, Any]
    seconds: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def open(cls, folder: AnyPath) -> Study:
        """Open a study's folder, or the report in it.

        Raises:
            InputError: it is none.
        """
        place = Path(folder)
        if (place / f"{_KIND}.json").is_file():
            place = place.parent
        return cls(place, read_json(place / "report" / f"{_KIND}.json", kind=_KIND))

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

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

        return read_parquet(self.folder / "report" / f"{name}.parquet", f"{name} of a study")

    def summary(self) -> Summary:
        """Return the headline, doubts and the differences of all classes, in a few values."""
        if not self.manifest:
            low, high = self.seconds
            return Summary(
                path=str(self.folder),
                reckoned_minutes=[round(low / 60, 1), round(high / 60, 1)],
            )
        told = self.manifest
        return Summary(
            path=str(self.folder),
            page=str(self.folder / "report" / "study.html"),
            in_short=told["in_short"],
            doubts=told["doubts"],
            recordings=told["recordings"],
            failed=[f"seed {one['seed']}, {one['cell']}: {one['why']}" for one in told["failed"]],
            effects=[
                {
                    "level": f"{row['factor']} = {row['level']}",
                    "figure": row["figure"],
                    **{
                        key: None if row[key] is None else round(row[key], 4)
                        for key in ("difference", "low", "high", "cohens_d", "cliffs_delta")
                    },
                }
                for row in told["effects"]
            ],
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
        >>> ut.study("grid.yaml").effects.to_pandas()
    """
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin
    from urbantwin.study.robustness import check_rigs, load_study, write_study
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
        for density in sorted({_density(cell) for cell in cells})
    }
    if not _frames(described, spec.rate_hz):
        raise InputError(
            "leaves no frame", file=described.file, place="start", expected="more seconds"
        )
    if described.model is not None or described.train is not None:
        from urbantwin.learn.torch_device import check_torch

        check_torch(device)
    check_folder(place / "report", kind=_KIND, inputs=[described.file, twin.folder])
    reckoned = _reckoned(described, rigs, len(traffics))
    tell_line(_first_line(described, rigs, reckoned), progress)
    if plan:
        return Study(place, {}, reckoned)
    course = _Course(described, twin, rig_file, place, traffics, workers, device, progress)
    model = course.model(rigs[0])
    found, failed = course.all_cells(cells, rigs, model)
    inputs = [described.file, twin.folder]
    with replaced_folder(place / "report", kind=_KIND, inputs=inputs) as folder:
        told_of = _told(described, twin, rigs[0], model)
        manifest = write_study(
            folder,
            described,
            [one.measured for one in found],
            [one.objects for one in found],
            failed,
            told_of,
        )
    shutil.rmtree(place / "work", ignore_errors=True)
    return Study(place, manifest, reckoned)


@dataclass(frozen=True)
class _Judge:
    """A detector, and what tells it from others."""

    model: Model
    sha256: str


@dataclass(frozen=True)
class _BaseOf:
    """What the recordings of one motion are judged by."""

    key: str
    counted: frozenset[tuple[str, int]]


@dataclass(frozen=True)
class _Found:
    measured: Measured
    objects: Mapping[str, int]
    new: bool


@dataclass(frozen=True)
class _Course:
    """How all recordings of a study are made and judged."""

    study: StudyFile
    twin: Twin
    rig_file: Path
    place: Path
    traffics: Mapping[float, dict[str, Any]]
    workers: int | None
    device: str
    progress: ShowProgress
    _motions: dict[tuple[int, float], tuple[str, Motion]] = field(default_factory=dict)

    def motion(self, seed: int, density: float, progress: ShowProgress) -> tuple[str, Motion]:
        """Return the motion of a seed and a density, and what tells it from others."""
        found = self._motions.get((seed, density))
        if found is None:
            name = f"seed-{seed}" + ("" if density == 1 else f"-density-{density:g}")
            folder = self.place / "motions" / name
            asked = {"seed": seed, "seconds": self.study.seconds, "twin": self.twin.sha256}
            asked["traffic"] = self.traffics.get(density, {})

            def drive(to: Path) -> None:
                traffic, length = self.traffics.get(density, {}), self.study.seconds
                driven(self.twin, to, traffic, length, seed, progress)

            key = self._steps.once(name, _of_this_version(asked), folder, drive)
            # Motions are large: of one seed at a time.
            self._motions.clear()
            found = self._motions[seed, density] = key, Motion.open(folder)
        return found

    def model(self, base: RigSpec) -> _Judge | None:
        """Return the detector: the one that was named, or one that is trained, or none."""
        folder, how = self.study.model, self.study.train
        if how is not None:
            folder = self.place / "model"
            keys, datasets = [], []
            for seed in how.seeds:
                key, motion = self.motion(seed, 1.0, self.progress)
                datasets.append(self.place / "training" / f"seed-{seed}")
                keys.append(
                    self._steps.once(
                        f"training-seed-{seed}",
                        {**self._recording(base), "motion": key},
                        datasets[-1],
                        partial(self.record, base, motion, seed, self.progress),
                    )
                )
            learned: dict[str, Any] = {**how.model_dump(exclude={"seeds"}), "part": "all"}
            learned |= {"device": self.device, "classes": self.study.classes}
            self._steps.once(
                "model",
                _of_this_version({"datasets": keys, **learned}),
                folder,
                partial(train, datasets, **learned, progress=self.progress),
            )
        if folder is None:
            return None
        from urbantwin.learn import read_model

        model = read_model(folder, self.device)
        return _Judge(model, sha256_of(folder / "model.safetensors"))

    def all_cells(
        self, cells: Sequence[Cell], rigs: Sequence[RigSpec], judge: _Judge | None
    ) -> tuple[list[_Found], list[dict[str, Any]]]:
        """Return what was measured, seed by seed, and which recordings failed, and why.

        Raises:
            StageError: the base of a seed failed.
        """
        from urbantwin.grid import Journal

        axes = self.study.axes
        journal = Journal(self.place / "cells.json")
        measured: list[_Found] = []
        failed: list[dict[str, Any]] = []
        total = len(self.study.seeds) * len(cells)
        with shown_stage("study", self.progress) as tell:
            for row, seed in enumerate(self.study.seeds):
                base: dict[float, _BaseOf] = {}
                for column, (cell, rig) in enumerate(zip(cells, rigs, strict=True)):
                    done = row * len(cells) + column
                    name = f"seed {seed}, {cell.name(axes)}"
                    told = between(tell, done / total, (done + 1) / total, name)
                    found = self.cell(seed, cell, rig, judge, base, journal, told)
                    if isinstance(found, str):
                        failed.append({"seed": seed, "cell": cell.name(axes), "why": found})
                        continue
                    measured.append(found)
                    if found.new and sum(one.new for one in measured) == 2:
                        left = (journal.seconds_each() or 0.0) * (total - done - 1)
                        tell_line(
                            f"study: by the first recordings, about {left / 60:.0f} minutes to go",
                            self.progress,
                        )
        return measured, failed

    def record(
        self, rig: RigSpec, motion: Motion, seed: int, progress: ShowProgress, folder: Path
    ) -> Dataset:
        """Record a motion by a rig; the same seed gives the same draws under every rig."""
        return recorded(
            self.twin,
            motion,
            rig,
            self.rig_file,
            folder,
            start_s=self.study.start_s,
            every=self.study.every,
            split=SplitAsked((1.0, 0.0, 0.0)),
            workers=self.workers,
            seed=seed,
            inputs=[self.twin.folder, motion.folder],
            pictures=False,
            progress=progress,
        )

    def cell(
        self,
        seed: int,
        cell: Cell,
        rig: RigSpec,
        judge: _Judge | None,
        base: dict[float, _BaseOf],
        journal: Journal,
        tell: Progress,
    ) -> _Found | str:
        """Return what was measured of one recording, or why it failed.

        Args:
            seed: of the motion.
            cell: its levels.
            rig: at these levels.
            judge: the detector.
            base: of each density the base of this seed, which the first cell with it becomes.
            journal: of what is done.
            tell: how far it is.

        Raises:
            StageError: it is a base, without which nothing can be compared, and failed.
        """
        from urbantwin.dataset.manifest import recipe_key
        from urbantwin.study.robustness import Measured

        density = _density(cell)
        motion_key, motion = self.motion(seed, density, between(tell, 0.0, 0.3))
        known = base.get(density)
        key = recipe_key(
            {
                **self._recording(rig),
                "motion": motion_key,
                "model": None if judge is None else judge.sha256,
                "classes": self.study.classes,
                "base": None if known is None else known.key,
            }
        )
        file = self.place / "cells" / f"{key}.json"
        new = not (journal.is_done(key) and file.is_file())
        if new:
            journal.forget(key)
        made = partial(self._make, file, key, rig, motion, seed, judge, known, tell)
        if not journal.once(key, made):
            why = journal.why(key) or "failed"
            if known is None:
                raise StageError(f"seed {seed}, {cell.name(self.study.axes)}: {why}")
            return why
        told = read_json(file, kind=_CELL)
        if known is None:
            counted = frozenset(
                (str(frame), int(track))
                for frame, tracks in told["counted"].items()
                for track in tracks
            )
            base[density] = _BaseOf(key, counted)
        return _Found(Measured(seed, cell, told["figures"]), told["objects"], new)

    def _make(
        self,
        file: Path,
        key: str,
        rig: RigSpec,
        motion: Motion,
        seed: int,
        judge: _Judge | None,
        base: _BaseOf | None,
        tell: Progress,
    ) -> None:
        """Record, detect, follow and judge; leave the figures in a file."""
        from urbantwin.study.robustness import judged_recording

        work = self.place / "work" / key
        dataset = self.record(rig, motion, seed, between(tell, 0.0, 0.6), work / "dataset")
        recording = recording_of_part(dataset.folder, None, "all")
        detections = None
        if judge is not None:
            from urbantwin.learn import detected

            detections = detected(
                judge.model, recording, device=self.device, tell=between(tell, 0.6, 0.8)
            )
        verdict = judged_recording(
            recording,
            detections,
            dataset.times_s.tolist(),
            classes=self.study.classes,
            base=None if base is None else base.counted,
            tell=between(tell, 0.8, 1.0),
        )
        counted: dict[str, list[int]] = {}
        if base is None:
            for frame, track in sorted(verdict.counted):
                counted.setdefault(frame, []).append(track)
        told = {"kind": _CELL, "figures": verdict.figures, "objects": verdict.objects}
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, {**told, "counted": counted})
        shutil.rmtree(work)

    @property
    def _steps(self) -> DoneSteps:
        return DoneSteps(self.place / "steps.json")

    def _recording(self, rig: RigSpec) -> dict[str, Any]:
        """Return what a recording by a rig is made from, but for its motion."""
        from urbantwin.dataset.provenance import asked_of

        asked = asked_of(rig, self.rig_file, self.twin)
        return _of_this_version(
            {"record": asked, "start_s": self.study.start_s, "every": self.study.every}
        )


def _of_this_version(asked: Mapping[str, Any]) -> dict[str, Any]:
    from urbantwin import __version__

    return {"urbantwin": __version__, **asked}


def _density(cell: Cell) -> float:
    return float(cell.levels.get("traffic_density", 1.0))


def _each_once(rigs: Sequence[RigSpec]) -> list[RigSpec]:
    return list({one.model_dump_json(): one for one in rigs}.values())


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
    low, high = (max(1, round(one / 60)) for one in reckoned)
    seeds, sensors = len(described.seeds), len(rigs[0].sensors)
    who = "nothing is detected"
    if described.train is not None:
        who = f"a detector of {described.train.steps} steps"
    elif described.model is not None:
        who = f"the detector {described.model.name}"
    return (
        f"study: {seeds} seed{'s' * (seeds != 1)} x {len(rigs)} cells = {seeds * len(rigs)} "
        f"recordings of {_frames(described, rigs[0].rate_hz)} frames by {sensors} "
        f"sensor{'s' * (sensors != 1)}; {who}; about {low} to {high} minutes on two processors"
    )


def _told(described: StudyFile, twin: Twin, rig: RigSpec, judge: _Judge | None) -> dict[str, Any]:
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
        **_of_this_version({"twin_sha256": twin.sha256}),
        "model": None if judge is None else {"sha256": judge.sha256, "trained": trained},
        "seconds": described.seconds,
        "start_s": described.start_s,
        "every": described.every,
    }
