"""What numba compiles: loops over rays. Types are inferred, so docstrings state them.

All arrays are C-ordered. Nothing here holds the interpreter's lock, so frames run on threads.
"""

__all__: list[str] = []
