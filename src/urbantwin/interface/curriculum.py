"""Curricula: graded datasets, from few near objects in plain sight to many far hidden ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import check_folder, replaced_folder, write_json
from urbantwin.errors import InputError
from urbantwin.interface.dataset import Dataset
from urbantwin.interface.motion import Motion, driven
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.recording import recorded, recorders
from urbantwin.interface.stage import ShowProgress
from urbantwin.interface.summary import Summary

if TYPE_CHECKING:
    from urbantwin.interface.twin import Twin

__all__ = ["Curriculum", "curriculum"]


@dataclass(frozen=True, repr=False)
class Curriculum:
    """Graded datasets in one folder, a folder each.

    Attributes:
        folder: where they are.
        grades: of each what was asked for and what was measured, the easiest first.
    """

    folder: Path
    grades: tuple[dict[str, Any], ...]

    def __fspath__(self) -> str:
        """Return the folder."""
        return str(self.folder)

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


def curriculum(  # noqa: PLR0913 - an option of the command each
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    ladder: str = "all",
    rig: AnyPath | None = None,
    seconds: float | None = None,
    start: float = 0.0,
    stop: float | None = None,
    seed: int | None = None,
    workers: int | None = None,
    progress: ShowProgress = True,
) -> Curriculum:
    """Record a dataset for each grade of a ladder of density, occlusion and range.

    Args:
        twin: the twin, or its folder.
        out: the folder for the datasets; ``graded`` beside the twin when not given.
        ladder: ``all`` (the three together), ``density``, ``occlusion``, ``range``, or a file with
            ``grades``.
        rig: the rig's file; the twin's own when not given.
        seconds: length of each motion; the site's ``traffic.duration_s`` if not given.
        start: no frame before this time of the motion, seconds.
        stop: no frame after this time.
        seed: of every random choice; the site's if not given.
        workers: processes to record with; every number gives the same bytes.
        progress: show how far it is; or a function that is told (share, doing), of each stage.

    Raises:
        InputError: the twin, the ladder or the rig cannot be used, or nobody is in a grade's reach.
        StageError: a stage failed.

    Example:
        >>> ut.curriculum(twin, ladder="range").datasets
    """
    from urbantwin.dataset.recording import frame_times
    from urbantwin.interface.rig import placed, rig_spec_on
    from urbantwin.interface.twin import Twin
    from urbantwin.variation import graded_rig, load_ladder, refuse_nobody, traffic_of_density

    place = beside(twin, "graded", out)
    grades = load_ladder(ladder)
    opened = Twin.open(twin)
    spec, file = rig_spec_on(opened, None if rig is None else Path(rig))
    if not spec.fused:
        raise InputError(
            "leaves a dataset for each sensor", file=file, expected="a rig with fused: true"
        )
    rigs = [graded_rig(spec, one) for one in grades]
    inputs = [opened.folder, None if rig is None else Path(rig)]
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
                motions[one.density] = driven(opened, folder, traffic, seconds, seed, progress)
            motion = motions[one.density]
            if not any(sensor.rides for sensor in its.sensors):
                times = frame_times(stands.rate_hz, start, stop, motion.times())
                refuse_nobody(one, stands, motion, opened.region, times.values())
            made = recorded(
                opened,
                motion,
                its,
                file,
                place / one.name,
                start_s=start,
                stop_s=stop,
                workers=crew,
                seed=seed,
                inputs=[opened.folder, motion.folder],
                pictures=False,
                progress=progress,
            )
            asked = {"density": one.density, "raised_m": one.raised_m, "range_m": one.range_m}
            measured = made.manifest["objects"]
            motion_of_it = motion.folder.name
            rows.append(
                {"name": one.name, "asked": asked, "motion": motion_of_it, "measured": measured}
            )
    manifest = {
        "kind": "curriculum",
        "ladder": ladder if ladder in ("all", "density", "occlusion", "range") else "own",
        "twin_sha256": opened.sha256,
        "grades": rows,
    }
    with replaced_folder(place / "ladder", kind="curriculum") as folder:
        write_json(folder / "curriculum.json", manifest)
    return Curriculum(place, tuple(rows))


def _motion_name(density: float) -> str:
    return f"motion-density-{density:g}"
