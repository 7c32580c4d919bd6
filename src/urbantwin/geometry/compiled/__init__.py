"""Code compiled by numba: rays through Embree's C interface, and the built-in tracer.

Types are inferred; docstrings describe them.

A function that is called for every ray is `per_ray`. Numba counts the references to every array
passed to a function, which costs as much as the work of one ray. `per_ray` disables this for
functions that neither create nor keep arrays. Records have no reference counts, and are passed as
pointers.
"""

from numba import njit

__all__ = ["per_block", "per_ray"]

#: For a function that creates arrays, or is called once for many rays.
per_block = njit(cache=True, nogil=True)
#: For a function that neither creates nor keeps arrays.
per_ray = njit(cache=True, nogil=True, _nrt=False)  # type: ignore[call-overload]
