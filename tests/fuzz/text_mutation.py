"""Changes to a text: its numbers, its words, its lines, its nesting."""

import random
import re

from .odd_values import NUMBERS, WORDS, depth

__all__ = ["TEXT", "is_text"]

_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb"[A-Za-z_][\w:./-]*")
_OPEN = [
    (b"[", b"]"),
    (b"{", b"}"),
    (b"(", b")"),
    (b'{"a":', b"}"),
    (b"<a>", b"</a>"),
    (b"- ", b""),
]


def is_text(data: bytes) -> bool:
    """Whether a file is text to its end, or text with a few bad bytes."""
    head = data[:4096]
    return bool(head) and sum(byte < 9 or byte > 126 for byte in head) < len(head) / 20


def _one(rng: random.Random, pattern: re.Pattern[bytes], data: bytes, value: bytes) -> bytes:
    """``data`` with one place where the pattern stands changed."""
    begin = rng.randrange(len(data) + 1) if rng.random() < 0.7 else 0
    found = pattern.search(data, begin) or pattern.search(data)
    return data if found is None else data[: found.start()] + value + data[found.end() :]


def number(rng: random.Random, data: bytes, other: bytes) -> bytes:
    for _ in range(rng.choice([1, 1, 1, 3])):
        data = _one(rng, _NUMBER, data, rng.choice(NUMBERS).encode())
    return data


def word(rng: random.Random, data: bytes, other: bytes) -> bytes:
    return _one(rng, _WORD, data, rng.choice(WORDS).encode("utf-8", "surrogatepass"))


def every(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """Every place where a number stands that one is, changed alike."""
    found = _NUMBER.findall(data[:100_000])
    if not found:
        return data
    value = rng.choice([text for text in NUMBERS if len(text) < 50]).encode()
    return re.sub(rb"(?<![\w.-])" + re.escape(rng.choice(found)) + rb"(?![\w.])", value, data)


def lines(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """A line lost, doubled, made endless, moved, or another file's line."""
    rows = data.split(b"\n")
    at = rng.randrange(len(rows))
    kind = rng.randrange(6)
    if kind == 0:
        del rows[at]
    elif kind == 1:
        rows.insert(at, rows[at])
    elif kind == 2:
        rows[at] = rows[at] * rng.choice([2, 1000])
    elif kind == 3:
        rows.insert(rng.randrange(len(rows)), rows.pop(at))
    elif kind == 4:
        rows.insert(at, rng.choice(other.split(b"\n")))
    else:
        return rng.choice([b"\r", b"\r\n", b" ", b"\0"]).join(rows)
    return b"\n".join(rows)


def nested(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """Nested far too deep: the whole, a part of it, or nothing but that."""
    begin, end = rng.choice(_OPEN)
    times = depth(rng)
    deep = begin * times + rng.choice([b"", b"1", b"x"]) + end * (times * rng.randrange(2))
    kind = rng.randrange(3)
    if kind == 0:
        return deep
    return _one(rng, _NUMBER if kind == 1 else _WORD, data, deep)


def encoding(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """The same text in other bytes, or bytes that are no text."""
    text = data.decode("utf-8", "replace")
    return rng.choice(
        [
            text.encode("utf-16"),
            text.encode("utf-32"),
            b"\xef\xbb\xbf" + data,
            data.replace(b"e", b"\xe9"),
            _one(rng, _WORD, data, b"\xff\xfe\x80"),
            _one(rng, _WORD, data, b"\xed\xa0\x80"),
        ]
    )


TEXT = {
    "number": number,
    "word": word,
    "every": every,
    "lines": lines,
    "nested": nested,
    "encoding": encoding,
}
