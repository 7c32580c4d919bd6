"""Paths: where simulated actors are, on the ground, apart from each other and from the scene."""

__all__: list[str] = []
