"""Experiments: cells of a grid as steps that are made once, and what they add up to."""

__all__: list[str] = []
