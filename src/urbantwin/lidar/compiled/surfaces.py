"""What surfaces send back: loops over what beams meet."""

import numpy as np

from urbantwin.geometry.compiled import per_ray

__all__ = ["mix", "read_actors", "read_curves"]


@per_ray
def read_curves(curves, material, cosine, out):
    """Write values (N,) float64 of the curves of materials, straight between their cosines.

    Args:
        curves: (M, S) float32, of each material at S cosines from 0 to 1.
        material: (N,) uint8.
        cosine: (N,) float32.
        out: to write.
    """
    for n in range(len(material)):
        out[n] = _read(curves, material[n], cosine[n])


@per_ray
def _read(curves, kind, cosine):
    """Return the value of a material's curve at one cosine."""
    steps = np.int32(curves.shape[1] - 1)
    faced = min(max(cosine, np.float32(0.0)), np.float32(1.0))
    place = faced * np.float32(steps)
    low = min(np.int32(place), steps - 1)
    first = curves[kind, low]
    step = np.float32(curves[kind, low + 1] - first)
    return np.float64(first) + np.float64(step) * (np.float64(place) - low)


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
def read_actors(curves, passes, beam, face, material, cosine, losses, backscatter, through):
    """Write what actors send back of beams (N,), and what passes through them.

    Args:
        curves: (M, S) float32, backscatter of each material, see `read_curves`.
        passes: (M, S) float32, share of the light that passes through it to and fro.
        beam: (N,) int32.
        face: (N,) int32, the triangle that it meets.
        material: (N,) uint8, of it.
        cosine: (N,) float32.
        losses: `returns.swallowed.Losses`.
        backscatter: (N,) float64, to write.
        through: (N,) float64, to write.
    """
    swallowed, left, panes, dirt = losses
    for n in range(len(beam)):
        kind = material[n]
        through[n] = _read(passes, kind, cosine[n])
        drawn = np.int64(_mixed(beam[n], face[n]) >> np.uint64(48))
        grain = np.float32(1.0)
        if panes[kind]:
            grain = dirt[drawn]
        elif drawn < swallowed[kind]:
            grain = left
        backscatter[n] = _read(curves, kind, cosine[n]) * np.float64(grain)
