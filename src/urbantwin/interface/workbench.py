"""Steps of experiments: drives, recordings, training and judgement, each of which is made once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urbantwin.artefact import digest_of
from urbantwin.dataset.split import SplitAsked
from urbantwin.experiments.journal import Journal, step_key
from urbantwin.interface.motion import Motion, driven
from urbantwin.interface.recording import recorded
from urbantwin.interface.stage import ShowProgress

if TYPE_CHECKING:
    from urbantwin.interface.evaluation_report import Evaluation
    from urbantwin.interface.twin import Twin
    from urbantwin.processes import Helpers
    from urbantwin.site import RigSpec

__all__ = ["WHOLE", "Workbench", "estimated_s", "minutes_text"]

#: A recording teaches, or judges, as a whole.
WHOLE = SplitAsked((1.0, 0.0, 0.0))
#: Estimated durations on two processors of a laptop, seconds, at least and at most: of a twin; of a
#: second of traffic; of a frame of one sensor; of judging a frame; of a training step with its
#: share of the second look.
_TWIN_S, _TRAFFIC_S, _FRAME_S, _JUDGED_S = (15.0, 200.0), (0.12, 1.2), (0.1, 0.8), (0.3, 1.5)
_STEP_S = (0.13, 0.7)
#: Factor of reading datasets and what else training takes beside its minutes.
_AROUND_TRAINING = (1.05, 1.4)


def estimated_s(
    *,
    twins: int = 0,
    traffic_s: float = 0.0,
    frames: float = 0.0,
    judged: float = 0.0,
    minutes: float = 0.0,
    steps: float | None = None,
) -> tuple[float, float]:
    """Return the least and the most seconds that steps are estimated to take on two processors.

    Args:
        twins: number of twins to build.
        traffic_s: traffic to drive, seconds.
        frames: number of frames to record, times one more than the sensors.
        judged: number of frames to detect in and judge.
        minutes: minutes of training.
        steps: number of training steps, in place of minutes.
    """
    low, high = (
        twins * _TWIN_S[k]
        + traffic_s * _TRAFFIC_S[k]
        + frames * _FRAME_S[k]
        + judged * _JUDGED_S[k]
        + (60 * minutes if steps is None else steps * _STEP_S[k]) * _AROUND_TRAINING[k]
        for k in range(2)
    )
    return low, high


def minutes_text(seconds: tuple[float, float]) -> str:
    """Return an estimate in words: ``about 2 to 7 minutes on two processors``."""
    low, high = (round(one / 60) for one in seconds)
    words = "less than a minute"
    if high > 0:
        span = f"{high}" if high in (low, 1) else f"{max(low, 1)} to {high}"
        words = f"about {span} minute{'s' * (high != 1)}"
    return f"{words} on two processors"


@dataclass(frozen=True)
class Workbench:
    """Where the steps of an experiment are made one after the other; finished steps stay.

    Attributes:
        journal: of the experiment: what is finished, by the hash of its inputs.
        twin: that is driven and recorded.
        workers: processes to record with.
        device: of PyTorch.
        progress: shows every stage.
    """

    journal: Journal
    twin: Twin
    workers: int | Helpers | None = None
    device: str = "cpu"
    progress: ShowProgress = True

    @property
    def folder(self) -> Path:
        """The folder of the experiment."""
        return self.journal.folder

    def once(
        self, place: str, make: Callable[[Path], object], inputs: Sequence[Path], **asked: object
    ) -> Path:
        """Make a step unless it is finished, and return its folder.

        Args:
            place: of its folder in the experiment's.
            make: makes it, in a folder.
            inputs: artefacts and recordings that it is made from.
            asked: everything else that it is made from, as JSON holds it.
        """
        key = step_key({"inputs": [digest_of(one) for one in inputs], **asked})
        self.journal.once(place, key, make)
        return self.folder / place

    def motion(
        self, place: str, seconds: float | None, seed: int | None, changes: Mapping[str, Any]
    ) -> Path:
        """Drive the twin's traffic with changes to it."""

        def make(folder: Path) -> None:
            driven(self.twin, folder, changes, seconds, seed, self.progress)

        asked = {"seconds": seconds, "seed": seed, "traffic": dict(changes)}
        return self.once(place, make, [self.twin.folder], **asked)

    def dataset(
        self,
        place: str,
        motion: Motion | Path,
        spec: RigSpec,
        rig_file: Path,
        *,
        background: Sequence[str] = (),
        split: SplitAsked | None = WHOLE,
        **span: Any,  # noqa: ANN401 - see `record`
    ) -> Path:
        """Record a motion by a rig.

        Args:
            place: of the dataset's folder in the experiment's.
            motion: the motion, or its folder.
            spec: the rig with every change to it.
            rig_file: where it was written.
            background: ``FILE`` or ``NAME=FILE`` of what real sensors measured of the static world;
                where they measured nothing, the twin is seen.
            split: of the dataset; ``None``: the usual one.
            span: ``seed``, ``start_s``, ``stop_s`` and ``every`` of `recording.recorded`.
        """
        from urbantwin.dataset.provenance import asked_of

        fuse = bool(background)
        rig = asked_of(spec, rig_file, self.twin, background=background, fuse=fuse)
        how = {"background": background, "split": split, **span}
        make = partial(self.record, motion, spec, rig_file, **how)
        inputs = [self.twin.folder, motion.folder if isinstance(motion, Motion) else motion]
        parts = None if split is None else split.told()
        return self.once(place, make, inputs, rig=rig, split=parts, **span)

    def record(
        self,
        motion: Motion | Path,
        spec: RigSpec,
        rig_file: Path,
        folder: Path,
        *,
        background: Sequence[str] = (),
        split: SplitAsked | None = WHOLE,
        **span: Any,  # noqa: ANN401
    ) -> None:
        """Record a motion by a rig into a folder; see `dataset`."""
        moving = motion if isinstance(motion, Motion) else Motion.open(motion)
        recorded(
            self.twin,
            moving,
            spec,
            rig_file,
            folder,
            background=background,
            fuse=bool(background),
            split=split,
            workers=self.workers,
            inputs=[self.twin.folder, moving.folder],
            pictures=False,
            progress=self.progress,
            **span,
        )

    def model(
        self,
        place: str,
        datasets: Sequence[Path],
        weights: Path | None = None,
        **how: Any,  # noqa: ANN401 - see `train`
    ) -> Path:
        """Train a detector on datasets, from first weights if given."""
        from urbantwin.interface.trained_model import train

        how = {"device": self.device, **how}
        inputs = [*datasets, *([] if weights is None else [weights])]

        def make(folder: Path) -> None:
            train(datasets, folder, weights=weights, progress=self.progress, **how)

        return self.once(place, make, inputs, **how)

    def detections(self, place: str, model: Path, data: Path) -> Path:
        """Detect in all frames of a recording."""
        from urbantwin.interface.detected_objects import detect

        make = partial(detect, model, data, device=self.device, progress=self.progress)
        return self.once(place, make, [model, data])

    def report(self, place: str, model: Path, data: Path) -> Evaluation:
        """Judge a detector by a labelled recording."""
        from urbantwin.interface.evaluation_report import Evaluation, evaluate

        make = partial(evaluate, model, data, progress=self.progress)
        return Evaluation(self.once(place, make, [model, data]))
