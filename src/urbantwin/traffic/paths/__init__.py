"""Paths of simulated actors: on the ground, without overlaps between them or with the scene."""

__all__: list[str] = []
