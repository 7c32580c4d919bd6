"""Loops over points that numba compiles. Types are inferred; words tell them."""

__all__: list[str] = []
