"""Loops over points of recordings, compiled by numba."""

__all__: list[str] = []
