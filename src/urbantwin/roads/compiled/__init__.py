"""Loops that numba compiles. Arguments are documented in words.

Arrays are of float64 unless said otherwise. Nothing here holds the interpreter's lock.
"""

__all__: list[str] = []
