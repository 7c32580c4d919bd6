"""Evaluation of detections against labels: precision, errors, false alarms, intervals."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.evaluation.criterion import CRITERIA, JUDGED, Criterion
    from urbantwin.evaluation.evaluate import Figures, Judged, evaluate
    from urbantwin.evaluation.reading import Seen, read_labelled
    from urbantwin.evaluation.truth import FEWEST_POINTS, Truth

__all__ = [
    "CRITERIA",
    "FEWEST_POINTS",
    "JUDGED",
    "Criterion",
    "Figures",
    "Judged",
    "Seen",
    "Truth",
    "evaluate",
    "read_labelled",
]

names_on_demand(__name__)
