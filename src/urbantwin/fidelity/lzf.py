"""LZF decompression, which ``binary_compressed`` PCD files use.

The format (Lehmann, LibLZF 3.6): a control byte below 32 is followed by that many plus one
literal bytes; else its upper three bits are the length of a copy less two (seven: one more
byte is added), and its lower five bits with the next byte are the distance back less one.
"""

from __future__ import annotations

__all__ = ["lzf_decompress"]


def lzf_decompress(data: bytes, size: int) -> bytes:
    """Return the ``size`` bytes that ``data`` holds.

    Raises:
        ValueError: the data ends early, points before its start or gives another size.
    """
    out = bytearray()
    at, end = 0, len(data)
    try:
        while at < end:
            control = data[at]
            at += 1
            if control < 32:
                if at + control + 1 > end:
                    raise ValueError("ends inside a run of bytes")
                out += data[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += data[at]
                at += 1
            length += 2
            back = ((control & 0x1F) << 8) + data[at] + 1
            at += 1
            start = len(out) - back
            if start < 0:
                raise ValueError("copies from before its start")
            if back >= length:
                out += out[start : start + length]
            else:  # the copy overlaps what it writes: the last `back` bytes repeat
                out += (bytes(out[start:]) * (length // back + 1))[:length]
    except IndexError:
        raise ValueError("ends inside a code") from None
    if len(out) != size:
        raise ValueError(f"holds {len(out)} bytes, not {size}")
    return bytes(out)
