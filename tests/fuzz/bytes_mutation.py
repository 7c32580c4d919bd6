"""Changes that need to know nothing of a file."""

import random

from .odd_values import BINARY

__all__ = ["BYTES"]


def _place(rng: random.Random, data: bytes) -> int:
    """A place in a file; half of the time in its first half kilobyte, where headers are."""
    end = min(len(data), 512) if rng.random() < 0.5 else len(data)
    return rng.randrange(end + 1)


def bits(rng: random.Random, data: bytes, other: bytes) -> bytes:
    changed = bytearray(data or b"\0")
    for _ in range(rng.choice([1, 1, 2, 8, 64])):
        changed[min(_place(rng, data), len(changed) - 1)] ^= 1 << rng.randrange(8)
    return bytes(changed)


def run(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """A run of bytes overwritten, taken out, or said twice."""
    begin = _place(rng, data)
    length = rng.choice([1, 4, 16, 256, 4096])
    kind = rng.randrange(4)
    if kind == 0:
        middle = rng.choice([b"\0", b"\xff", b" ", rng.randbytes(1)]) * length
        return data[:begin] + middle + data[begin + length :]
    if kind == 1:
        return data[:begin] + rng.randbytes(length) + data[begin + length :]
    if kind == 2:
        return data[:begin] + data[begin + length :]
    return data[: begin + length] + data[begin:]


def cut(rng: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: _place(rng, data)]


def splice(rng: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: _place(rng, data)] + other[_place(rng, other) :]


def count(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """What may be a count or a number, overwritten by a huge one or by none."""
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        value = rng.choice(BINARY)
        begin = _place(rng, data)
        if rng.random() < 0.7:
            begin -= begin % len(value)
        data = data[:begin] + value + data[begin + len(value) :]
    return data


def foreign(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """Nothing, or nothing but noise, or noise behind a true beginning."""
    noise = rng.randbytes(rng.choice([1, 100, 5000]))
    return rng.choice([b"", b"\0", b"\n", noise, data[:16] + noise, data + noise, b"\0" * 10_000])


BYTES = {"bits": bits, "run": run, "cut": cut, "splice": splice, "count": count, "foreign": foreign}
