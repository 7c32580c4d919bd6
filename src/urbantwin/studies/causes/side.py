"""A recording of a comparison: its detections, and the fate of each object."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from urbantwin.dataset.reading.manifest import read_manifest
from urbantwin.dataset.reading.turns import SensorTurns
from urbantwin.detections import Detections
from urbantwin.evaluation import JUDGED, Criterion, Seen, evaluate, read_labelled
from urbantwin.evaluation.matching import matched
from urbantwin.evaluation.pairs import Pairs, pairs_of
from urbantwin.evaluation.truth import counting, roles_of
from urbantwin.fidelity.readers import Recording
from urbantwin.progress import Progress, untold

__all__ = ["Side", "class_of", "read_side", "thresholds_of"]

#: Classes that are judged separately.
_CLASSES = tuple(name for name in JUDGED if name != "large")
_CLASS_OF = {actor: name for name in _CLASSES for actor in JUDGED[name]}


def class_of(actor: str) -> str | None:
    """Return the detector's class of an actor class, or ``None``."""
    return _CLASS_OF.get(actor)


@dataclass(frozen=True, eq=False)
class Side:
    """One recording.

    Attributes:
        name: name of the variant, or ``base``.
        recording: its frames.
        seen: detections and labels.
        pairs: pairs of a detection and a label that are close to each other.
        rows: row of ``seen.truth`` of each frame and track.
        fates: row of ``fates.parquet`` of each frame and track.
        weather: weather and visibility, from the conditions of the rig.
        lost: for each frame, the sensors with no data because all their sweeps were lost.
    """

    name: str
    recording: Recording
    seen: Seen
    pairs: Pairs
    rows: Mapping[tuple[str, int], int]
    fates: Mapping[tuple[str, int], Mapping[str, Any]]
    weather: tuple[str, float | None]
    lost: Mapping[str, frozenset[str]]

    def counting(self, objects: Collection[tuple[str, int]]) -> Side:
        """Return a copy in which only the given objects count."""
        return replace(self, seen=replace(self.seen, truth=counting(self.seen.truth, objects)))

    def found(
        self, criterion: Mapping[str, Criterion], least: Mapping[str, float]
    ) -> NDArray[np.int64]:
        """Return the detection (L,) that found each object; -1: it was missed, or does not count.

        Args:
            criterion: by class, the condition for a detection to match an object.
            least: by class, the minimum score of a detection that counts.
        """
        truth, score = self.seen.truth, self.seen.detections.score
        result = np.full(len(truth), -1, np.int64)
        for name in _CLASSES:
            mine = np.array([one in JUDGED[name] for one in self.seen.detections.class_names], bool)
            order = np.flatnonzero(mine & (score >= least.get(name, 0.0)))
            order = order[np.argsort(-score[order], kind="stable")]
            roles = roles_of(truth, name, layout=self.recording.layout, vans=False)
            told = matched(self.pairs, order, roles, self.seen.in_view, criterion[name])
            result[told.label[told.right]] = told.detection[told.right]
        return result


def read_side(
    name: str,
    recording: Recording,
    detections: Detections,
    fates: pa.Table,
    tell: Progress = untold,
) -> Side:
    """Read one recording.

    Args:
        name: name of the variant.
        recording: a dataset of ours.
        detections: detections in the recording.
        fates: fates of all variants, see `variation.fates_of`.
        tell: called with the progress.

    Raises:
        InputError: a file is damaged, or no frame is in both.
    """
    seen = read_labelled(detections, recording, tell=tell)
    truth = seen.truth
    rows = {
        (truth.frames[frame], track): row
        for row, (frame, track) in enumerate(
            zip(truth.frame.tolist(), truth.track.tolist(), strict=True)
        )
    }
    mine = [row for row in fates.to_pylist() if row["variant"] == name]
    folder = Path(recording.path)
    conditions = read_manifest(folder)["rig"]["conditions"]
    return Side(
        name,
        recording,
        seen,
        pairs_of(seen.detections, truth),
        rows,
        {(row["frame"], row["track"]): row for row in mine},
        (str(conditions["weather"]), conditions.get("visibility_m")),
        SensorTurns.in_folder(folder).lost_sensors,
    )


def thresholds_of(side: Side, score: float | None) -> dict[str, float]:
    """Return the minimum score of detections by class: the score of the best F1, or a fixed one.

    A class without objects in the recording gets the highest score of the other classes, so that
    its false detections have no effect.

    Args:
        side: the base recording: a threshold is set on it and kept for the variants.
        score: the same minimum score for all classes; ``None``: the score of the best F1.
    """
    if score is not None:
        return dict.fromkeys(_CLASSES, score)
    truth = side.seen.truth
    there = [
        name
        for name in _CLASSES
        if (roles_of(truth, name, layout=side.recording.layout, vans=False) > 0).any()
    ]
    if not there:
        return {}
    judged = evaluate(side.seen, layout=side.recording.layout, classes=there, draws=1)
    known = {name: one.threshold for name, one in judged.classes.items()}
    rest = max(known.values())
    return {name: known.get(name, rest) for name in _CLASSES}
