"""Loops that numba compiles: who waits for whom. Arguments are documented in words.

Arrays are float64 unless said otherwise; lengths in metres, times in seconds.
"""
