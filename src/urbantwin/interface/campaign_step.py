"""A step of a campaign made: a twin, a motion or a dataset, in any process."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.campaigns import Outcome
from urbantwin.errors import InputError, NoRoomError, TooLittleRoomError
from urbantwin.grid.journal import ATTEMPTS
from urbantwin.progress import Progress

if TYPE_CHECKING:
    from urbantwin.campaigns import CampaignFile, Step
    from urbantwin.interface.motion import Motion
    from urbantwin.interface.twin import Twin

__all__ = ["RUNNING", "Maker", "begin", "check_seen", "make"]

#: Where in a campaign's folder each step that is under way says how far it is.
RUNNING = "journal/running"
#: It says so at most this often, seconds.
_SAID_S = 1.0


def _nobody() -> None:
    """Watch nothing."""


@dataclass
class Maker:
    """What makes the steps of a campaign.

    Attributes:
        asked: the campaign.
        place: its folder.
        twins: folders of twins that were built before, by the name of their site.
        workers: processes to record each dataset with; every number gives the same bytes.
        watch: called now and then while a step is made, in the process that makes it.
    """

    asked: CampaignFile
    place: Path
    twins: dict[str, Path]
    workers: int = 1
    watch: Callable[[], None] = _nobody
    # Motions are large: recordings of one follow each other.
    _last: tuple[str, Twin, Motion] | None = None

    def outcome(self, step: Step) -> Outcome:
        """Make a step, once more if it fails; whatever happens to it is told, not raised."""
        attempt, why = 0, ""
        while attempt < ATTEMPTS:
            attempt += 1
            began, worked = time.monotonic(), _processor_s()
            try:
                told = self._make(step)
            except (NoRoomError, TooLittleRoomError) as error:
                return Outcome(why=str(error), attempts=attempt, no_room=True)
            except InputError as error:  # which trying again does not change
                return Outcome(why=str(error), attempts=attempt)
            except Exception as error:  # a cell that fails must not end all others
                why = str(error) or type(error).__name__
                continue
            told |= {
                "size": step.size,
                "seconds": round(time.monotonic() - began, 3),
                "processor_s": round(_processor_s() - worked, 3),
            }
            return Outcome(told, attempts=attempt)
        return Outcome(why=why, attempts=attempt)

    def _make(self, step: Step) -> dict[str, Any]:
        folder = self.place / step.place
        file = self.place / RUNNING / f"{step.kind}-{step.name}"
        with _says_how_far(file, self.watch) as tell:
            if step.kind == "twin":
                from urbantwin.interface.twin import build_of, site_with_known_sensors

                site = site_with_known_sensors(self.asked.sites[step.name])
                build_of(site, folder, pictures=False, progress=tell)
                return {}
            if step.kind == "motion":
                return self._drive(step, folder, tell)
            return self._record(step, folder, tell)

    def _twin(self, site: str) -> Twin:
        from urbantwin.interface.twin import Twin

        return Twin.open(self.twins.get(site, self.place / "twins" / site))

    def _drive(self, step: Step, folder: Path, tell: Progress) -> dict[str, Any]:
        from urbantwin.interface.motion import driven

        twin = self._twin(step.cell["site"])
        events = self.asked.scenarios[step.cell["scenario"]]
        changes: dict[str, object] = {}
        if events is not None:
            from urbantwin.traffic.events import load_scenario

            changes["scenario"] = load_scenario(events, twin, step.size)
        driven(twin, folder, changes, self.asked.duration_s, int(step.cell["seed"]), tell)
        return {}

    def _record(self, step: Step, folder: Path, tell: Progress) -> dict[str, Any]:
        from urbantwin.campaigns.index import dataset_told
        from urbantwin.campaigns.steps import rig_at_rate
        from urbantwin.interface.motion import Motion
        from urbantwin.interface.recording import recorded
        from urbantwin.interface.rig import rig_spec_on

        moving = self.place / step.needs[-1]
        if self._last is None or self._last[0] != step.needs[-1]:
            twin = self._twin(step.cell["site"])
            self._last = (step.needs[-1], twin, Motion.open(moving))
        _, twin, motion = self._last
        spec, file = rig_spec_on(twin, self.asked.rigs[step.cell["rig"]])
        spec = rig_at_rate(spec, self.asked.rate_hz)
        setting = next(one for one in self.asked.weather if one.name == step.cell["weather"])
        recorded(
            twin,
            motion,
            setting.applied_to(spec),
            file,
            folder,
            start_s=self.asked.start_s,
            every=self.asked.every,
            storage=self.asked.storage,
            split=self.asked.split,
            workers=self.workers,
            seed=int(step.cell["seed"]),
            inputs=[twin.folder, moving],
            pictures=False,
            progress=tell,
        )
        return dataset_told(folder)


_maker: Maker | None = None


def begin(maker: Maker) -> None:
    """Begin a worker: from now on it makes steps."""
    global _maker  # noqa: PLW0603 - a worker's only state
    _maker = maker


def make(step: Step) -> Outcome:
    """Make a step in a worker; a SIGTERM takes back what is half made, and ends the worker."""
    from urbantwin.interruption import EXIT_CODE, Interruptions, unwinds

    assert _maker is not None
    interruptions = Interruptions()
    try:
        with unwinds() as interruptions:
            return _maker.outcome(step)
    finally:
        # Of a pool whose other workers have ended already nobody would ever tell this one to.
        if interruptions.count:
            os._exit(EXIT_CODE)


def check_seen(files: Sequence[Path]) -> None:
    """Refuse files on a machine that does not see them.

    Raises:
        InputError: one is not there.
    """
    for file in files:
        if not file.exists():
            raise InputError(
                "is not seen from there", file=file, expected="a folder that every node sees"
            )


def _processor_s() -> float:
    """Return the time of processors that this process and its children took, seconds."""
    import resource  # not on Windows

    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


@contextmanager
def _says_how_far(file: Path, watch: Callable[[], None]) -> Iterator[Progress]:
    """Yield what writes into a file how far a step is; the file goes when the step ends."""
    said = 0.0

    def tell(share: float, doing: str) -> None:
        nonlocal said
        now = time.monotonic()
        if now - said < _SAID_S:
            return
        said = now
        file.parent.mkdir(parents=True, exist_ok=True)
        part = file.with_name(f".{file.name}")
        part.write_text(f"{share:.4f} {doing}", encoding="utf-8")
        part.replace(file)
        watch()

    try:
        yield tell
    finally:
        file.unlink(missing_ok=True)
