"""The static world as a sensor sees it: loops over all of its beams."""

from urbantwin.geometry.compiled import per_ray

__all__ = ["answer_beams", "places_along", "turn_directions"]


@per_ray
def answer_beams(echoes, layer_class, which, out, amplitude):
    """Write what beams (N,) answer: what their echoes do, or nothing.

    Args:
        echoes: `echoes.Echoes`, all of the static world.
        layer_class: (L,) uint16, class of each layer of the static world.
        which: (N,) int32, the echo of each beam; -1 for none.
        out: `echoes.Answers` to write, (N,).
        amplitude: (N,) float32, of the echo, to write.
    """
    level, range_m, sigma, intensity, semantic = out
    for n in range(len(which)):
        one = which[n]
        if one < 0:
            level[n], range_m[n], sigma[n], intensity[n] = 0, 0.0, 0.0, 0.0
            semantic[n], amplitude[n] = 0, 0.0
            continue
        level[n], range_m[n] = echoes.level[one], echoes.range_m[one]
        sigma[n], intensity[n] = echoes.sigma[one], echoes.intensity[one]
        semantic[n] = layer_class[-1 - echoes.owner[one]]
        amplitude[n] = echoes.amplitude[one]


@per_ray
def turn_directions(directions, rotation, out):
    """Write directions (3, N) float32 of beams (N, 3), turned with rotations (K, 3, 3) of columns.

    Beam = channel * K + column.
    """
    columns = len(rotation)
    for first in range(0, len(directions), columns):
        for k in range(columns):
            n = first + k
            x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
            for i in range(3):
                out[i, n] = rotation[k, i, 0] * x + rotation[k, i, 1] * y + rotation[k, i, 2] * z


@per_ray
def places_along(directions, rotation, translation, ray, range_m, out):
    """Write where rays (M,) end (M, 3).

    Args:
        directions: (N, 3) float64 unit vectors of the beams; beam = channel * K + column.
        rotation: (K, 3, 3) float64, of the columns.
        translation: (K, 3) float64.
        ray: (M,) int32, the beam of each.
        range_m: (M,) float32.
        out: (M, 3) float64.
    """
    columns = len(rotation)
    for m in range(len(ray)):
        n, k = ray[m], ray[m] % columns
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        for i in range(3):
            along = rotation[k, i, 0] * x + rotation[k, i, 1] * y + rotation[k, i, 2] * z
            out[m, i] = translation[k, i] + along * range_m[m]
