"""Counterfactuals: the same recording with one factor changed, and the fate of every object."""

__all__: list[str] = []
