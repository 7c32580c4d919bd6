"""Loops that numba compiles: who is near whom, and who waits. Arguments are documented in words.

Arrays are of float64 unless said otherwise, lengths in metres and times in seconds. Nothing here
holds the interpreter's lock.
"""

__all__: list[str] = []
