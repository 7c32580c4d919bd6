"""Alignment: estimates a sensor's pose in the twin from its real frames."""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.fidelity.alignment.align import Alignment, Guess, align
    from urbantwin.fidelity.alignment.ground_plane import GroundPlane, ground_plane
    from urbantwin.fidelity.alignment.rig_alignment import (
        Wish,
        align_rig,
        aligned_poses,
        draw_alignment,
        frame_numbers,
        write_aligned_rig,
    )

__all__ = [
    "Alignment",
    "GroundPlane",
    "Guess",
    "Wish",
    "align",
    "align_rig",
    "aligned_poses",
    "draw_alignment",
    "frame_numbers",
    "ground_plane",
    "write_aligned_rig",
]

names_on_demand(__name__)
