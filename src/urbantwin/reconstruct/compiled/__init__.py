"""Loops over points of recordings that numba compiles."""

__all__: list[str] = []
