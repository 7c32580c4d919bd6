"""What bars the way: walls, fences, hedges, guard rails, kerb stones, gates, bollards, boulders."""

from urbantwin.scene.barrier.lines import barrier_mesh

__all__ = ["barrier_mesh"]
