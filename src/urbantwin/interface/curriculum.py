"""Curricula: datasets graded from few, near, visible objects to many, far, occluded ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.experiments.journal import Journal
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.motion import Motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.recording import recorders
from urbantwin.interface.stage import ShowProgress
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.interface.workbench import Workbench

if TYPE_CHECKING:
    from urbantwin.experiments.ladder import Grade

__all__ = ["Curriculum", "curriculum"]


@dataclass(frozen=True, repr=False)
class Curriculum(Artefact):
    """Graded datasets, one folder each, in one folder.

    Attributes:
        folder: the folder.
        grades: requested and measured values of each grade, in order of ascending difficulty.
    """

    folder: Path
    grades: tuple[dict[str, Any], ...]

    def __repr__(self) -> str:
        """Return the grades and the folder."""
        names = ", ".join(row["name"] for row in self.grades)
        return f"Curriculum of {len(self.grades)} grades: {names} ({self.folder})"

    @property
    def datasets(self) -> dict[str, Dataset]:
        """Datasets by the names of their grades, in order of ascending difficulty."""
        return {row["name"]: Dataset(self.folder / row["name"]) for row in self.grades}

    def summary(self) -> Summary:
        """Return the measured values of each grade."""
        rows = [
            {
                "grade": row["name"],
                "objects_per_frame": row["measured"]["per_frame"],
                "points_per_object": row["measured"]["points"],
                "occlusion": row["measured"]["occlusion"],
                "hidden": row["measured"]["hidden"],
                "distance_p90_m": (row["measured"]["distance_m"] or {}).get("p90"),
            }
            for row in self.grades
        ]
        return Summary(path=str(self.folder), grades=rows)


def curriculum(
    grid: Path,
    out: AnyPath | None = None,
    *,
    workers: int | None = None,
    progress: ShowProgress = True,
) -> Curriculum:
    """Record a dataset per grade of a ladder of density, occlusion and range.

    Raises:
        InputError: the twin or the rig cannot be used, or a grade has no object in reach.
        StageError: a stage failed.
    """
    from urbantwin.dataset.recording import frame_times
    from urbantwin.experiments.ladder import (
        CurriculumFile,
        graded_rig,
        refuse_nobody,
        traffic_of_density,
    )
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin

    file, place = CurriculumFile.read(grid), beside(grid, "graded", out)
    twin = Twin.open(file.twin)
    spec, rig_file = rig_spec_on(twin, file.rig)
    if not spec.fused:
        raise InputError(
            "leaves a dataset for each sensor", file=rig_file, expected="a rig with fused: true"
        )
    rigs = [graded_rig(spec, grade) for grade in file.grades]
    inputs = [twin.folder, file.rig]
    standing = [placed(rig, twin, rig_file) for rig in rigs]  # check before simulating
    traffics = {
        grade.density: traffic_of_density(
            twin.site["traffic"], grade.density, f"grade {grade.name}"
        )
        for grade in file.grades
    }
    for grade in file.grades:
        check_folder(place / grade.name, kind="dataset", inputs=inputs)
        check_folder(place / _motion_name(grade), kind="motion", inputs=inputs)
    motions: dict[float, Motion] = {}
    rows = []
    with recorders(workers, pictures=False) as crew:
        bench = Workbench(Journal(place), twin, crew, progress=progress)
        for grade, rig, stands in zip(file.grades, rigs, standing, strict=True):
            density, name = grade.density, _motion_name(grade)
            if density not in motions:
                folder = bench.motion(name, file.seconds, file.seed, traffics[density])
                motions[density] = Motion.open(folder)
            motion = motions[density]
            if not any(sensor.rides for sensor in rig.sensors):
                times = frame_times(stands.rate_hz, file.start, file.stop, motion.times())
                refuse_nobody(grade, stands, motion, twin.region, times.values())
            span: dict[str, Any] = {"start_s": file.start, "stop_s": file.stop, "seed": file.seed}
            data = Dataset(bench.dataset(grade.name, motion, rig, rig_file, split=None, **span))
            asked = {"density": density, "raised_m": grade.raised_m, "range_m": grade.range_m}
            measured = data.manifest["objects"]
            row = {"name": grade.name, "asked": asked, "motion": name, "measured": measured}
            rows.append(row)
    manifest = {
        "kind": "curriculum",
        "ladder": file.ladder,
        "twin_sha256": twin.sha256,
        "grades": rows,
    }
    with replaced_folder(place / "ladder", kind="curriculum") as folder:
        write_json(folder / "curriculum.json", manifest)
    return Curriculum(place, tuple(rows))


def _motion_name(grade: Grade) -> str:
    return f"motion-density-{grade.density:g}"
