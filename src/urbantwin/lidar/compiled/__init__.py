"""What numba compiles: loops over rays. Types are inferred, so arguments are told in words.

All arrays are C-ordered. Nothing here holds the interpreter's lock, so frames run on threads.
"""

__all__: list[str] = []
