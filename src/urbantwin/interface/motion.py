"""Motions: traffic simulated on a twin, or opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import Ge, Interval

from urbantwin.artefact import check_folder, sha256_of
from urbantwin.interface.command import command
from urbantwin.interface.outcome import outcome_of_motion
from urbantwin.interface.place import AnyPath, beside
from urbantwin.interface.stage import ShowProgress, shown_stage, tell_result
from urbantwin.interface.summary import Artefact, Summary
from urbantwin.traffic.motion import Motion as DrivenMotion
from urbantwin.traffic.motion import describe

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from urbantwin.interface.twin import Twin

__all__ = ["Motion", "drive", "driven"]


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Artefact, DrivenMotion):
    """Pose of every actor at every step, and the signal states.

    ``actors`` and ``signals`` are tables of pyarrow; ``at(time_s)`` gives the actors of one step as
    a structured array, and ``times()`` the steps. It can be passed as its folder.

    Attributes:
        folder: the motion's folder.

    Example:
        >>> motion = ut.open("out/motion")
        >>> motion.actors.to_pandas().groupby("class")["speed"].mean()
        >>> motion.at(3.0)["x"]
    """

    folder: Path = field(default=Path())

    @classmethod
    def open(cls, folder: AnyPath) -> Motion:
        """Open a motion's folder; a motion is returned as it is.

        Raises:
            InputError: the folder is not a motion, or is damaged.
        """
        if isinstance(folder, Motion):
            return folder
        return replace(cls.load(Path(folder)), folder=Path(folder))

    @classmethod
    def load(cls, folder: Path) -> Motion:
        """Read a motion's folder; see `open`."""
        read = DrivenMotion.load(folder)
        return cls.of(read, folder)

    @classmethod
    def of(cls, driven: DrivenMotion, folder: Path) -> Motion:
        """Return a motion stored in a folder."""
        parts = {one.name: getattr(driven, one.name) for one in fields(DrivenMotion)}
        return cls(**parts, folder=folder)

    def __repr__(self) -> str:
        """Return duration, counts, seed and folder."""
        seen = {
            name: row["seen"]
            for name, row in self.manifest.get("classes", {}).items()
            if row["seen"]
        }
        actors = ", ".join(f"{count} {name}" for name, count in seen.items()) or "no actors"
        return (
            f"Motion of {self.manifest['steps'] * self.step_s:g} s in steps of {self.step_s:g} s: "
            f"{actors}; seed {self.manifest['seed']} ({self.folder})"
        )

    def summary(self) -> Summary:
        """Return the motion's content in brief."""
        told = [str(one) for one in self.warnings]
        return Summary(
            path=str(self.folder),
            **{**describe(self.folder), **outcome_of_motion(self)},
            warnings=told,
        )

    def plot(self, twin: Twin | None = None) -> Figure:
        """Draw the path of every actor from above.

        Args:
            twin: twin whose lanes are drawn; if not given, the twin beside the motion, if it is the
                motion's own.
        """
        from urbantwin.drawing.pictures import figure_of_motion
        from urbantwin.interface.twin import Twin

        beside_it = self.folder.parent / "twin"
        named = beside_it / "twin.json"
        if twin is None and named.is_file():
            its_own = sha256_of(named) == self.manifest["twin_sha256"]
            twin = Twin.open(beside_it) if its_own else None
        return figure_of_motion(self, twin)


@command
def drive(
    twin: Twin | AnyPath,
    out: AnyPath | None = None,
    *,
    seconds: Annotated[float | None, Interval(ge=0.1, le=86400)] = None,
    seed: Annotated[int | None, Ge(0)] = None,
    demand: AnyPath | None = None,
    scenario: AnyPath | None = None,
    counts: AnyPath | None = None,
    detectors: AnyPath | None = None,
    time_of_day: Annotated[str | None, "HH:MM"] = None,
    pictures: bool = True,
    progress: ShowProgress = True,
) -> Motion:
    """Simulate a twin's traffic: every actor at every step.

    Args:
        twin: twin, or its folder.
        out: folder to write, in which an older motion is replaced; ``motion`` beside the twin if
            not given.
        seconds: length of the motion, seconds; the site's ``traffic.duration_s`` if not given.
        seed: random seed; the site's ``traffic.seed`` if not given.
        demand: file with fields of ``traffic:`` that replace the site's, as ``rig tune`` and
            ``traffic calibrate`` write it.
        scenario: ``scenario.yaml``: rare events at a place and a time (docs/howto/events.md).
        counts: counted traffic, a table (CSV) by approach and turn, road, crossing, or origin and
            destination, per quarter of an hour; or the output of SUMO's detectors (XML, CSV).
        detectors: positions of the detectors of the counts: SUMO's additional file.
        time_of_day: time of day at which the motion begins, ``08:00``; the site's
            ``traffic.time_of_day`` if not given.
        pictures: draw the paths of the actors, and each event, into the motion's folder.
        progress: show progress; or a function that is called with (share, doing).

    Raises:
        InputError: the twin, the demand or ``out`` cannot be used.
        StageError: SUMO failed, or the disk is full.

    Example:
        >>> motion = ut.drive(twin, seconds=60)
        $ urbantwin drive urbantwin-demo/twin -o motion/ --seconds 60
    """
    from urbantwin.interface.twin import Twin
    from urbantwin.site import load_traffic_changes
    from urbantwin.site.traffic import checked_time_of_day
    from urbantwin.traffic.demand.counts_table import read_counts

    place = beside(twin, "motion", out)
    file = None if demand is None else Path(demand)
    events = None if scenario is None else Path(scenario)
    table = None if counts is None else Path(counts)
    loops = None if detectors is None else Path(detectors)
    check_folder(place, kind="motion", inputs=[Path(twin), file, events, table, loops])
    changes = {} if file is None else load_traffic_changes(file)
    if table is not None:
        changes = {**changes, "counts": read_counts(table, loops)}
    if time_of_day is not None:
        changes = {**changes, "time_of_day": checked_time_of_day(time_of_day)}
    loaded = Twin.open(twin)
    if events is not None:
        from urbantwin.traffic.events import load_scenario

        usual = changes.get("duration_s", loaded.site["traffic"]["duration_s"])
        until_s = usual if seconds is None else seconds
        changes = {**changes, "scenario": load_scenario(events, loaded, until_s)}

    def draw(driven: DrivenMotion, folder: Path) -> None:
        from urbantwin.drawing.pictures import picture_of_motion, pictures_of_events

        (folder / "pictures").mkdir()
        picture_of_motion(driven, loaded, folder / "pictures" / "paths.png")
        pictures_of_events(driven, loaded, folder / "pictures")

    made = driven(loaded, place, changes, seconds, seed, progress, also=draw if pictures else None)
    tell_result("traffic", place, made.warnings, progress)
    return made


def driven(
    twin: Twin,
    folder: Path,
    changes: Mapping[str, object],
    seconds: float | None,
    seed: int | None,
    progress: ShowProgress,
    *,
    also: Callable[[DrivenMotion, Path], None] | None = None,
) -> Motion:
    """Simulate a twin's traffic with changes to the site's traffic; see `drive`.

    Draws only what ``also`` draws into the motion's folder, and prints no messages.
    """
    from urbantwin.traffic.run import run_traffic

    with shown_stage("traffic", progress) as tell:
        made = run_traffic(
            twin, folder, seconds=seconds, seed=seed, changes=changes, also=also, progress=tell
        )
    return Motion.of(made, folder)
