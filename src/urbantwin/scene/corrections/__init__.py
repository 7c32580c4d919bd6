"""Corrections of what stands: poles, walls and trees that a person added or removed."""

from urbantwin.scene.corrections.added import added_things
from urbantwin.scene.corrections.removed import without_barriers, without_things

__all__ = ["added_things", "without_barriers", "without_things"]
