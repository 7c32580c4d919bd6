"""What surfaces send back: loops over what beams meet."""

import numpy as np

from urbantwin.geometry.compiled import per_ray

__all__ = ["mix", "read_curves"]


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
        mixed = np.uint64(beam[n]) << np.uint64(32) | np.uint64(face[n])
        mixed = (mixed ^ mixed >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
        out[n] = (mixed ^ mixed >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
