"""Loops over points that numba compiles. Types are inferred; words tell them."""
