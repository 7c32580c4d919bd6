"""What surfaces send back: loops over what beams meet."""

import numpy as np

from urbantwin.geometry.compiled import per_ray

__all__ = ["mix", "read_curves", "swallow"]


@per_ray
def read_curves(curves, material, cosine, out):
    """Write values (N,) float64 of the curves of materials, straight between their cosines.

    Args:
        curves: (M, S) float32, of each material at S cosines from 0 to 1.
        material: (N,) uint8.
        cosine: (N,) float32.
        out: to write.
    """
    steps = np.int32(curves.shape[1] - 1)
    for n in range(len(material)):
        faced = min(max(cosine[n], np.float32(0.0)), np.float32(1.0))
        place = faced * np.float32(steps)
        low = min(np.int32(place), steps - 1)
        first = curves[material[n], low]
        step = np.float32(curves[material[n], low + 1] - first)
        out[n] = np.float64(first) + np.float64(step) * (np.float64(place) - low)


@per_ray
def mix(beam, face, out):
    """Write random bits (N,) uint64 of beams (N,) int32 that meet triangles (N,) int32.

    Steele, Lea and Flood 2014, OOPSLA: the mixing function of SplitMix64.
    """
    for n in range(len(beam)):
        out[n] = _mixed(beam[n], face[n])


@per_ray
def _mixed(beam, face):
    """Return random bits of a beam that meets a triangle."""
    mixed = np.uint64(beam) << np.uint64(32) | np.uint64(face)
    mixed = (mixed ^ mixed >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    return (mixed ^ mixed >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)


@per_ray
def swallow(beam, face, material, swallowed, left, panes, dirt, out):
    """Write what is left (N,) float32 of the backscatter of actors: see `returns.swallowed`.

    Args:
        beam: (N,) int32.
        face: (N,) int32, the triangle that it meets.
        material: (N,) uint8, of it.
        swallowed: (M,) int64, level of 65,536 below which a draw is swallowed, by material.
        left: float32, what is left of it then.
        panes: (M,) bool, which materials are panes.
        dirt: (65536,) float32, what dirt leaves of a pane, by draw.
        out: to write.
    """
    for n in range(len(beam)):
        drawn, kind = _mixed(beam[n], face[n]) >> np.uint64(48), material[n]
        if panes[kind]:
            out[n] = dirt[drawn]
        else:
            out[n] = left if np.int64(drawn) < swallowed[kind] else np.float32(1.0)
