"""How the recordings of a study are made and judged, and which of them are done."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import read_json, sha256_of, write_json
from urbantwin.dataset.split import SplitAsked
from urbantwin.errors import StageError
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.done_steps import DoneSteps
from urbantwin.interface.motion import Motion, driven
from urbantwin.interface.parts import recording_of_part
from urbantwin.interface.recording import recorded
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.interface.trained_model import train
from urbantwin.progress import Progress, between

if TYPE_CHECKING:
    from urbantwin.grid import Cell, Journal
    from urbantwin.interface.twin import Twin
    from urbantwin.learn import Model
    from urbantwin.site import RigSpec
    from urbantwin.studies.robustness import Measured, StudyFile

__all__ = ["Course", "Found", "Judge", "density_of", "of_this_version"]

#: Of a file of a cell: what is in it.
_CELL = "cell"


@dataclass(frozen=True)
class Judge:
    """A detector, and what tells it from others."""

    model: Model
    sha256: str


@dataclass(frozen=True)
class BaseOf:
    """What the recordings of one motion are judged by."""

    key: str
    counted: frozenset[tuple[str, int]]


@dataclass(frozen=True)
class Found:
    """One recording that succeeded.

    Attributes:
        measured: its figures.
        objects: how many objects count, by class.
        new: whether this run made it.
    """

    measured: Measured
    objects: Mapping[str, int]
    new: bool


@dataclass(frozen=True)
class Course:
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

            key = self._steps.once(name, of_this_version(asked), folder, drive)
            # Motions are large: of one seed at a time.
            self._motions.clear()
            found = self._motions[seed, density] = key, Motion.open(folder)
        return found

    def model(self, base: RigSpec) -> Judge | None:
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
                of_this_version({"datasets": keys, **learned}),
                folder,
                partial(train, datasets, **learned, progress=self.progress),
            )
        if folder is None:
            return None
        from urbantwin.learn import read_model

        model = read_model(folder, self.device)
        return Judge(model, sha256_of(folder / "model.safetensors"))

    def all_cells(
        self, cells: Sequence[Cell], rigs: Sequence[RigSpec], judge: Judge | None
    ) -> tuple[list[Found], list[dict[str, Any]]]:
        """Return what was measured, seed by seed, and which recordings failed, and why.

        Raises:
            StageError: the base of a seed failed.
        """
        from urbantwin.grid import Journal

        axes = self.study.axes
        journal = Journal(self.place / "cells.jsonl")
        measured: list[Found] = []
        failed: list[dict[str, Any]] = []
        total = len(self.study.seeds) * len(cells)
        with shown_stage("study", self.progress) as tell:
            for row, seed in enumerate(self.study.seeds):
                base: dict[float, BaseOf] = {}
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
        judge: Judge | None,
        base: dict[float, BaseOf],
        journal: Journal,
        tell: Progress,
    ) -> Found | str:
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
        from urbantwin.studies.robustness import Measured

        density = density_of(cell)
        motion_key, motion = self.motion(seed, density, between(tell, 0.0, 0.3))
        known = base.get(density)
        key = recipe_key(
            {
                **self._recording(rig),
                "motion": motion_key,
                "model": None if judge is None else judge.sha256,
                "classes": self._classes(judge),
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
            base[density] = BaseOf(key, counted)
        return Found(Measured(seed, cell, told["figures"]), told["objects"], new)

    def _make(
        self,
        file: Path,
        key: str,
        rig: RigSpec,
        motion: Motion,
        seed: int,
        judge: Judge | None,
        base: BaseOf | None,
        tell: Progress,
    ) -> None:
        """Record, detect, follow and judge; leave the figures in a file."""
        from urbantwin.studies.robustness import judged_recording

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
            classes=self._classes(judge),
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

    def _classes(self, judge: Judge | None) -> Sequence[str] | None:
        """Return the classes that are judged: others than the detector's would water the mean."""
        if self.study.classes is None and judge is not None:
            return judge.model.design.classes
        return self.study.classes

    @property
    def _steps(self) -> DoneSteps:
        return DoneSteps(self.place / "steps.json")

    def _recording(self, rig: RigSpec) -> dict[str, Any]:
        """Return what a recording by a rig is made from, but for its motion."""
        from urbantwin.dataset.provenance import asked_of

        asked = asked_of(rig, self.rig_file, self.twin)
        return of_this_version(
            {"record": asked, "start_s": self.study.start_s, "every": self.study.every}
        )


def of_this_version(asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return what something is made from, with the version that makes it."""
    from urbantwin import __version__

    return {"urbantwin": __version__, **asked}


def density_of(cell: Cell) -> float:
    """Return how many times the site's traffic a cell has."""
    return float(cell.levels.get("traffic_density", 1.0))
