"""Corrections of objects: poles, walls and trees added or removed by the user."""

from urbantwin.scene.corrections.added import added_things
from urbantwin.scene.corrections.removed import without_barriers, without_things

__all__ = ["added_things", "without_barriers", "without_things"]
