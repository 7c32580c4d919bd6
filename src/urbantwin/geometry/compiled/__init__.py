"""What numba compiles: rays through Embree's C interface, and the built-in tracer that has it too.

Types are inferred; words tell them.

A function that is called for every ray is `per_ray`. Numba counts the owners of every array that
a function is handed, which costs as much as the work of one ray; it does not where the function
neither makes nor keeps arrays and says so. Records have no owners, and are handed on as pointers.
"""

from numba import njit

__all__ = ["per_block", "per_ray"]

#: For a function that makes arrays, or is called once for many rays.
per_block = njit(cache=True, nogil=True)
#: For a function that neither makes nor keeps arrays.
per_ray = njit(cache=True, nogil=True, _nrt=False)  # type: ignore[call-overload]
