"""Loops over points, compiled by numba. Types are inferred; docstrings state them."""

__all__: list[str] = []
