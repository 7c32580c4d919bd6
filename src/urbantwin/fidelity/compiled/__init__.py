"""Loops compiled by numba: nearest points and triangles; docstrings describe the arguments.

The loops release the interpreter's lock, so parts of a query run on threads.
"""

__all__: list[str] = []
