"""SUMO: its input, its process, and what is steered within it."""

__all__: list[str] = []
