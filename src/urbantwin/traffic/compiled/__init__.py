"""Loops that numba compiles: who is near whom, and who waits. Arguments are documented in words.

Arrays are of float64 unless said otherwise, lengths in metres and times in seconds. Nothing here
holds the interpreter's lock.
"""

from urbantwin.geometry.compiled import per_ray

__all__ = ["per_actor"]

#: For a function that is called for an actor or a pair in every step, and neither makes nor keeps
#: arrays: what holds for rays (`geometry.compiled`) holds for them.
per_actor = per_ray
