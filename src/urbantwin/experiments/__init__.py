"""Experiments: cells of a grid as steps that run once, and their combined results."""

__all__: list[str] = []
