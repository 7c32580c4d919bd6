"""Recording and evaluation of a study's cells, each once."""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from urbantwin.artefact import digest_of, read_json, sha256_of, write_json
from urbantwin.errors import StageError
from urbantwin.interface.motion import Motion
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_line
from urbantwin.progress import Progress, between

if TYPE_CHECKING:
    from urbantwin.experiments.grid import Cell
    from urbantwin.experiments.study.effects import Measured
    from urbantwin.experiments.study.file import StudyFile
    from urbantwin.interface.workbench import Workbench
    from urbantwin.learn import Model
    from urbantwin.site import RigSpec

__all__ = ["Detector", "StudyCourse", "density_of"]


class Detector(NamedTuple):
    """A detector, and the SHA-256 of its weights."""

    model: Model
    sha256: str


@dataclass
class StudyCourse:
    """Records and evaluates the cells of a study."""

    file: StudyFile
    rig_file: Path
    traffics: Mapping[float, dict[str, Any]]
    bench: Workbench
    detector: Detector | None = None
    # Motions are large: only one is kept.
    _motion: tuple[tuple[int, float], Motion] | None = None

    def motion(self, seed: int, density: float, progress: ShowProgress) -> Motion:
        """Return the motion of a seed and a traffic density."""
        if self._motion is None or self._motion[0] != (seed, density):
            name = f"seed-{seed}" + ("" if density == 1 else f"-density-{density:g}")
            traffic = self.traffics.get(density, {})
            bench = replace(self.bench, progress=progress)
            folder = bench.motion(f"motions/{name}", self.file.seconds, seed, traffic)
            self._motion = (seed, density), Motion.open(folder)
        return self._motion[1]

    def span(self, seed: int) -> dict[str, Any]:
        """Return the options of the recorded frames; a seed gives the same draws for every rig."""
        return {"seed": seed, "start_s": self.file.start, "every": self.file.every}

    def detector_of(self, base: RigSpec) -> Detector | None:
        """Return the named or a newly trained detector, or None."""
        folder, how = self.file.model, self.file.train
        if how is not None:
            datasets = [
                self.bench.dataset(
                    f"training/seed-{seed}",
                    self.motion(seed, 1.0, self.bench.progress),
                    base,
                    self.rig_file,
                    **self.span(seed),
                )
                for seed in how.seeds
            ]
            learned = how.model_dump(exclude={"seeds"})
            folder = self.bench.model(
                "model", datasets, part="all", classes=self.file.classes, **learned
            )
        if folder is None:
            return None
        from urbantwin.learn import read_model

        model = read_model(folder, self.bench.device)
        return Detector(model, sha256_of(folder / "model.safetensors"))

    def cells(self, rigs: Sequence[RigSpec]) -> tuple[list[Measured], list[dict[str, Any]]]:
        """Return the figures of all recordings, by seed, and the failures.

        Raises:
            StageError: the base of a seed failed.
        """
        from urbantwin.experiments.study.effects import Measured

        cells, axes = self.file.cells(), self.file.axes
        measured: list[Measured] = []
        failed: list[dict[str, Any]] = []
        total, new, began_s = len(self.file.seeds) * len(cells), 0, time.monotonic()
        bases: dict[tuple[int, float], dict[str, Any]] = {}
        with shown_stage("study", self.bench.progress) as tell:
            for number, (seed, column) in enumerate(product(self.file.seeds, range(len(cells)))):
                cell = cells[column]
                of_motion = seed, density_of(cell)
                name = f"seed {seed}, {cell.name(axes)}"
                told = between(tell, number / total, (number + 1) / total, name)
                base = bases.get(of_motion)
                try:
                    row, made = self.cell(*of_motion, rigs[column], base, told)
                except StageError as error:
                    if base is None:  # nothing can be compared without a base
                        raise StageError(f"{name}: {error}") from None
                    row = {"seed": seed, "cell": cell.name(axes), "why": str(error)}
                    failed.append(row)
                    continue
                bases.setdefault(of_motion, row)
                measured.append(Measured(seed, cell, row["figures"], row["objects"]))
                new += made
                if made and new == 2:
                    left_s = (time.monotonic() - began_s) / 2 * (total - number - 1)
                    tell_line(
                        f"study: by the first recordings, about {left_s / 60:.0f} minutes to go",
                        self.bench.progress,
                    )
        return measured, failed

    def cell(
        self,
        seed: int,
        density: float,
        rig: RigSpec,
        base: Mapping[str, Any] | None,
        tell: Progress,
    ) -> tuple[dict[str, Any], bool]:
        """Return the figures of one recording, and whether it was made now.

        Args:
            seed: seed of the motion.
            density: traffic density, a multiple of the site's.
            rig: the cell's rig.
            base: figures of the base of the same motion; ``None`` for the base itself.
            tell: called with the fraction done and a description.

        Raises:
            StageError: recording failed twice.
        """
        from urbantwin.dataset.provenance import asked_of
        from urbantwin.experiments.journal import ATTEMPTS, step_key

        motion = self.motion(seed, density, between(tell, 0.0, 0.3))
        key = step_key(
            {
                "motion": digest_of(motion.folder),
                "record": asked_of(rig, self.rig_file, self.bench.twin),
                "span": self.span(seed),
                "model": None if self.detector is None else self.detector.sha256,
                "classes": self._classes,
                "base": None if base is None else base["key"],
            }
        )
        place = f"cells/{key}.json"

        def make(file: Path) -> None:
            work = self.bench.folder / "work" / key
            bench = replace(self.bench, progress=between(tell, 0.0, 0.6))
            bench.record(motion, rig, self.rig_file, work, **self.span(seed))
            row = self._judged(work, base, tell)
            file.parent.mkdir(parents=True, exist_ok=True)
            write_json(file, {"kind": "cell", **row})
            shutil.rmtree(work)

        made = self.bench.journal.once(place, key, make, attempts=ATTEMPTS)
        return {**read_json(self.bench.folder / place, kind="cell"), "key": key}, made

    def _judged(
        self, dataset: Path, base: Mapping[str, Any] | None, tell: Progress
    ) -> dict[str, Any]:
        """Detect, track and evaluate; return the figures, and for a base the objects that count."""
        from urbantwin.experiments.study.judging import judged_recording
        from urbantwin.interface.dataset import Dataset
        from urbantwin.interface.parts import recording_of_part

        recording, detections = recording_of_part(dataset, None, "all"), None
        if self.detector is not None:
            from urbantwin.learn import detected

            device, telling = self.bench.device, between(tell, 0.6, 0.8)
            detections = detected(self.detector.model, recording, device=device, tell=telling)
        counted = None
        if base is not None:
            rows = base["counted"].items()
            counted = {(str(frame), int(track)) for frame, tracks in rows for track in tracks}
        verdict = judged_recording(
            recording,
            detections,
            Dataset(dataset).times_s.tolist(),
            classes=self._classes,
            base=counted,
            tell=between(tell, 0.8, 1.0),
        )
        counts: dict[str, list[int]] = {}
        for frame, track in sorted(verdict.counted) if base is None else ():
            counts.setdefault(frame, []).append(track)
        return {"figures": verdict.figures, "objects": verdict.objects, "counted": counts}

    @property
    def _classes(self) -> Sequence[str] | None:
        """Classes to evaluate; classes unknown to the detector would lower the mean."""
        if self.file.classes is None and self.detector is not None:
            return self.detector.model.design.classes
        return self.file.classes


def density_of(cell: Cell) -> float:
    """Return a cell's traffic density as a multiple of the site's."""
    return float(cell.levels.get("traffic_density", 1.0))
