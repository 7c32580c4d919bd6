"""Values that no reader should take for what they stand for."""

import random

#: In place of a number of a text.
NUMBERS = [
    "nan", "NaN", "-nan", ".nan", "inf", "-inf", "Infinity", "-Infinity", ".inf", "-.inf", "1e400",
    "-1e400", "1e308", "-1e308", "1e-320", "1_0", "1__0", "_1", "0x10", "0b1", "0o17", "1,5",
    "--1", "+-1", "+1", "1e", "1.2.3", "-0", "0", "-1", "1", "255", "256", "65535", "65536",
    "100000", "2147483647", "2147483648", "-2147483649", "4294967295", "4294967296", "999999999",
    "10000000000", "9007199254740993", "9223372036854775807", "9223372036854775808",
    "-9223372036854775809", "18446744073709551616", "1" + "0" * 40, "-" + "9" * 400, "9" * 5000,
    "0." + "3" * 5000, "1e99999", "1e-99999", "١٢", "１２", "²", "½", "1\u00a0000", " 1", "",
    "null", "true", "~", "90", "180.0000001", "-181", "361", "1e9", "1e15", "1e22",
]  # fmt: skip

#: In place of a word of a text.
WORDS = [
    "", " ", "\0", "a\0b", "\x1b[31mred\x1b[0m", "\x07", "\r", "\n", "\t", "\u202eesrever",
    "\u2028", "\ufeff", "%s%n", "{0}", "../../../../etc/passwd", "/dev/zero", "/", ".", "..",
    "~", "a" * 300, "a" * 80_000, "é" * 300, "\U0001f600", "\ud800", "NaN", "null", "-1", "0",
    "https://example.invalid/", "file:///etc/passwd", "data:,", "<", "&", '"', "'", "\\", "#", ":",
]  # fmt: skip

#: In place of a value of a document: JSON, YAML.
VALUES: list[object] = [
    None, True, False, 0, 1, -1, 0.0, -0.5, 1e308, -1e308, 5e-324, float("nan"), float("inf"),
    float("-inf"), 255, 2**31, -(2**31) - 1, 2**32, 2**53 + 1, 2**63, 2**64, 10**25, 10**400,
    100_000, 10**9, "", "x", "0", "1e400", "nan", "1_0", "\0", "\x1b[2J", "a" * 80_000, "\ud800",
    [], [[]], [None], {}, {"": {}}, {"a": [1]}, [0] * 1000, [float("nan")] * 3, [[0, 0]] * 4,
    [1, 2, 3], ["a", "b"], "../..", "/dev/zero", [2**63] * 3, [1e308] * 3, [1e200, -1e200, 1e200],
]  # fmt: skip

#: In place of bytes of a file: counts, sizes and numbers, little and big endian.
BINARY = [
    *(n.to_bytes(2, order) for n in (0, 1, 0x7FFF, 0x8000, 0xFFFF) for order in ("little", "big")),
    *(
        n.to_bytes(4, order)
        for n in (0, 1, 0xFFFF, 0xFFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF)
        for order in ("little", "big")
    ),
    *(
        n.to_bytes(8, "little")
        for n in (0, 2**31, 2**32, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
    ),
    bytes.fromhex("0000c07f"), bytes.fromhex("0000807f"), bytes.fromhex("000080ff"),  # float32
    bytes.fromhex("ffff7f7f"), bytes.fromhex("01000000"),
    bytes.fromhex("000000000000f87f"), bytes.fromhex("000000000000f07f"),  # float64
    bytes.fromhex("000000000000f0ff"), bytes.fromhex("ffffffffffffef7f"),
]  # fmt: skip


def depth(rng: random.Random) -> int:
    """How deep to nest: just too deep for a parser that calls itself, or far too deep."""
    return rng.choice([50, 500, 1100, 3000, 20_000, 100_000])
