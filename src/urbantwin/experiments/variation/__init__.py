"""Counterfactuals: the same recording with one factor changed, and what became of every object."""

__all__: list[str] = []
