"""Steps of experiments (drives, recordings, training, evaluation), each run once."""

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

#: No split: a recording is used as a whole.
WHOLE = SplitAsked((1.0, 0.0, 0.0))
#: Estimated durations on two processors of a laptop, seconds, lower and upper: per twin, per second
#: of traffic, per frame of a sensor, per evaluated frame, and per training step with its share of
#: the second stage.
_TWIN_S, _TRAFFIC_S, _FRAME_S, _JUDGED_S = (15.0, 200.0), (0.12, 1.2), (0.1, 0.8), (0.3, 1.5)
_STEP_S = (0.13, 0.7)
#: Factors on the training time for reading datasets and other overhead, lower and upper.
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
    """Return the lower and upper estimate of the run time on two processors, seconds.

    Args:
        twins: number of twins to build.
        traffic_s: traffic to simulate, seconds.
        frames: number of frames to record, times one more than the number of sensors.
        judged: number of frames to detect in and evaluate.
        minutes: minutes of training.
        steps: number of training steps; replaces ``minutes``.
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
    """Runs the steps of an experiment; finished steps are kept.

    Attributes:
        journal: the experiment's journal of finished steps, by the hash of their inputs.
        twin: twin to simulate and record.
        workers: number of recording processes, or running helpers.
        device: device of PyTorch.
        progress: progress display of every stage.
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
        """Run a step unless it is finished, and return its folder.

        Args:
            place: path of its folder within the experiment's folder.
            make: function that runs the step in a given folder.
            inputs: input artefacts and recordings.
            asked: all other inputs, JSON-compatible.
        """
        key = step_key({"inputs": [digest_of(one) for one in inputs], **asked})
        self.journal.once(place, key, make)
        return self.folder / place

    def motion(
        self, place: str, seconds: float | None, seed: int | None, changes: Mapping[str, Any]
    ) -> Path:
        """Simulate the twin's traffic with changes applied."""

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
        """Record a motion with a rig.

        Args:
            place: path of the dataset's folder within the experiment's folder.
            motion: the motion, or its folder.
            spec: the rig, with all changes applied.
            rig_file: the rig's file.
            background: measured static worlds of real sensors, ``FILE`` or ``NAME=FILE``; the twin
                is used where they have no data.
            split: split of the dataset; ``None`` for the default split.
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
        """Record a motion with a rig into a folder; see `dataset`."""
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
        """Train a detector on datasets, from initial weights if given."""
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
        """Evaluate a detector on a labelled recording."""
        from urbantwin.interface.evaluation_report import Evaluation, evaluate

        make = partial(evaluate, model, data, progress=self.progress)
        return Evaluation(self.once(place, make, [model, data]))
