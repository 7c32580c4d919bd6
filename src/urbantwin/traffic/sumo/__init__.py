"""SUMO: its input, its process, and the control of actors within it."""

__all__: list[str] = []
