"""What numba compiles: one ray at a time through Embree. Types are inferred; words tell them."""

__all__: list[str] = []
