"""Barriers: walls, fences, hedges, guard rails, kerb stones, gates, bollards, boulders."""

from urbantwin.scene.barrier.linear import barrier_mesh

__all__ = ["barrier_mesh"]
