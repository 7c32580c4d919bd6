"""Stray light of bright echoes: blooming into neighbouring beams, crosstalk between channels."""

import numpy as np

from urbantwin.geometry.compiled import per_block

__all__ = ["crosstalk", "spill"]


@per_block
def spill(bright, strength, beams, rings, columns, skirt, floor, out):
    """Write the stray echoes that bright ones cause in the beams around them.

    Args:
        bright: `returns.strays.Source`; beam = channel * columns + column.
        strength: (B,) float32, of them.
        beams: (N, 3) float64 unit vectors.
        rings: `beams.Rings`, elevation and azimuth by channel.
        columns: K.
        skirt: share of the light that lands one width of the beam aside, and this width, radians;
            it falls with the cube of the angle.
        floor: strength below which nothing is noticed.
        out: beam int32, source int32 (number in ``bright``), amplitude float32; to write.

    Returns:
        How many there are (written only while there is room).
    """
    elevation, azimuth, step = rings.elevation, rings.azimuth, rings.turn * rings.step
    share, width = skirt
    out_beam, out_source, out_amplitude = out
    used = 0
    for b in range(len(bright.beam)):
        beam = bright.beam[b]
        channel, column = beam // columns, beam % columns
        reach = width * (share * strength[b] / floor) ** (1.0 / 3.0)
        if reach < width:
            continue
        x, y, z = beams[beam, 0], beams[beam, 1], beams[beam, 2]
        for other in range(len(elevation)):
            if abs(elevation[other] - elevation[channel]) > reach:
                continue
            shift = int(np.rint((azimuth[channel] - azimuth[other]) / step))
            wide = int(reach / (abs(step) * max(np.cos(elevation[other]), 0.05))) + 1
            wide = min(wide, columns // 2)
            for k in range(column + shift - wide, column + shift + wide + 1):
                aside = other * columns + k % columns
                if aside == beam:
                    continue
                cosine = x * beams[aside, 0] + y * beams[aside, 1] + z * beams[aside, 2]
                # Of a small angle the cosine knows half of the digits: more than enough.
                angle = np.arccos(min(cosine, 1.0))
                if angle > reach:
                    continue
                lands = share * min(1.0, (width / max(angle, 1e-9)) ** 3)
                if used < len(out_beam):
                    out_beam[used], out_source[used] = aside, b
                    out_amplitude[used] = bright.amplitude[b] * lands
                used += 1
    return used


@per_block
def crosstalk(bright, strength, ring_time, columns, share, floor, out):
    """Write the stray echoes that bright ones cause in channels that fire at the same time.

    Args:
        bright: `returns.strays.Source`.
        strength: (B,) float32, of them.
        ring_time: (C,) float64, when each channel fires.
        columns: K.
        share: of the light that another channel notices.
        floor: strength below which nothing is noticed.
        out: see `spill`.

    Returns:
        How many there are.
    """
    out_beam, out_source, out_amplitude = out
    used = 0
    for b in range(len(bright.beam)):
        if share * strength[b] < floor:
            continue
        channel, column = bright.beam[b] // columns, bright.beam[b] % columns
        for other in range(len(ring_time)):
            if other == channel or ring_time[other] != ring_time[channel]:
                continue
            if used < len(out_beam):
                out_beam[used], out_source[used] = other * columns + column, b
                out_amplitude[used] = bright.amplitude[b] * share
            used += 1
    return used
