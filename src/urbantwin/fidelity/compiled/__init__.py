"""Loops that numba compiles: nearest points and triangles. Arguments are documented in words.

Nothing here holds the interpreter's lock, so parts of a query run on threads.
"""

__all__: list[str] = []
