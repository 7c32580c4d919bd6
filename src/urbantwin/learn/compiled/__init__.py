"""Loops over points and boxes that numba compiles."""
