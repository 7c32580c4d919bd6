"""Curricula: graded datasets, from few near objects in plain sight to many far hidden ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.motion import Motion, driven
from urbantwin.interface.place import AnyPath
from urbantwin.interface.recording import recorded, recorders
from urbantwin.interface.stage import ShowProgress
from urbantwin.interface.summary import Artefact, Summary

if TYPE_CHECKING:
    from urbantwin.variation import CurriculumFile

__all__ = ["Curriculum", "curriculum"]


@dataclass(frozen=True, repr=False)
class Curriculum(Artefact):
    """Graded datasets in one folder, a folder each.

    Attributes:
        folder: where they are.
        grades: of each what was asked for and what was measured, the easiest first.
    """

    folder: Path
    grades: tuple[dict[str, Any], ...]

    def __repr__(self) -> str:
        """Return the grades and the folder."""
        names = ", ".join(row["name"] for row in self.grades)
        return f"Curriculum of {len(self.grades)} grades: {names} ({self.folder})"

    @property
    def datasets(self) -> dict[str, Dataset]:
        """The datasets by the names of their grades, the easiest first."""
        return {row["name"]: Dataset(self.folder / row["name"]) for row in self.grades}

    def summary(self) -> Summary:
        """Return what was measured of each grade."""
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
    asked: CurriculumFile,
    out: AnyPath,
    *,
    workers: int | None = None,
    progress: ShowProgress = True,
) -> Curriculum:
    """Record a dataset for each grade of a ladder of density, occlusion and range.

    Raises:
        InputError: the twin or the rig cannot be used, or no object is in a grade's reach.
        StageError: a stage failed.
    """
    from urbantwin.dataset.recording import frame_times
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin
    from urbantwin.variation import graded_rig, refuse_nobody, traffic_of_density

    place, grades, seed = Path(out), asked.grades, asked.seed
    opened = Twin.open(asked.twin)
    spec, file = rig_spec_on(opened, asked.rig)
    if not spec.fused:
        raise InputError(
            "leaves a dataset for each sensor", file=file, expected="a rig with fused: true"
        )
    rigs = [graded_rig(spec, one) for one in grades]
    inputs = [opened.folder, asked.rig]
    standing = [placed(its, opened, file) for its in rigs]  # before anything is driven
    for one in grades:
        check_folder(place / one.name, kind="dataset", inputs=inputs)
    traffics = {
        one.density: traffic_of_density(opened.site["traffic"], one.density, f"grade {one.name}")
        for one in grades
    }
    for density in traffics:
        check_folder(place / _motion_name(density), kind="motion", inputs=inputs)
    motions: dict[float, Motion] = {}
    rows = []
    with recorders(workers, pictures=False) as crew:
        for one, its, stands in zip(grades, rigs, standing, strict=True):
            if one.density not in motions:
                folder = place / _motion_name(one.density)
                traffic = traffics[one.density]
                motions[one.density] = driven(
                    opened, folder, traffic, asked.seconds, seed, progress
                )
            motion = motions[one.density]
            if not any(sensor.rides for sensor in its.sensors):
                times = frame_times(stands.rate_hz, asked.start, asked.stop, motion.times())
                refuse_nobody(one, stands, motion, opened.region, times.values())
            made = recorded(
                opened,
                motion,
                its,
                file,
                place / one.name,
                start_s=asked.start,
                stop_s=asked.stop,
                workers=crew,
                seed=seed,
                inputs=[opened.folder, motion.folder],
                pictures=False,
                progress=progress,
            )
            wanted = {"density": one.density, "raised_m": one.raised_m, "range_m": one.range_m}
            measured = made.manifest["objects"]
            motion_of_it = motion.folder.name
            rows.append(
                {"name": one.name, "asked": wanted, "motion": motion_of_it, "measured": measured}
            )
    manifest = {
        "kind": "curriculum",
        "ladder": asked.ladder,
        "twin_sha256": opened.sha256,
        "grades": rows,
    }
    with replaced_folder(place / "ladder", kind="curriculum") as folder:
        write_json(folder / "curriculum.json", manifest)
    return Curriculum(place, tuple(rows))


def _motion_name(density: float) -> str:
    return f"motion-density-{density:g}"
