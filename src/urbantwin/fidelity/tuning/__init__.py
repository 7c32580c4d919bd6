"""Tuning: fits uncertain parameters of a rig and its traffic to unlabelled real frames."""

from urbantwin.fidelity.tuning.frames import Split, split_in_time
from urbantwin.fidelity.tuning.knobs import GROUPS, groups_of
from urbantwin.fidelity.tuning.tune import Tuning, tune

__all__ = ["GROUPS", "Split", "Tuning", "groups_of", "split_in_time", "tune"]
