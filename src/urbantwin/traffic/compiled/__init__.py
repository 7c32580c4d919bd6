"""Loops compiled by numba: neighbours, waiting and evasion.

Arguments have no types, so docstrings state them. Arrays are of float64 unless stated otherwise,
lengths in metres and times in seconds. The functions release the interpreter's lock.
"""

from urbantwin.geometry.compiled import per_ray

__all__ = ["per_actor"]

#: For functions called per actor or pair in every step that neither create nor keep arrays, as for
#: rays (`geometry.compiled`).
per_actor = per_ray
