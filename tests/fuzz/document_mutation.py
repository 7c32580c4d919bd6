"""Changes to a document (JSON, YAML, XML) that leave it a document."""

import json
import random
import re
from collections.abc import Callable
from copy import deepcopy

import yaml

from .odd_values import NUMBERS, VALUES, WORDS, depth

__all__ = ["changed_value", "document_of"]

_LONGEST = 300_000
_ATTRIBUTE = re.compile(rb"""([\w:-]+)=(["'])([^"']*)\2""")
_ELEMENT = re.compile(rb"<(\w+)[^<>]*?/>|<(\w+)[^<>]*>[^<>]*</\2>")
_BOMB = b'<!DOCTYPE a [<!ENTITY b "xxxxxxxxxx">%s]>' % b"".join(
    b'<!ENTITY %s "%s">' % (chr(99 + i).encode(), (b"&%s;" % chr(98 + i).encode()) * 10)
    for i in range(9)
)


def changed_value(rng: random.Random, value: object) -> object:
    """Return a document with one of its values lost, doubled, renamed or of another kind."""
    holders: list[dict | list] = []
    stack, seen = [value], set()  # aliases of YAML are one list at many places
    while stack:
        here = stack.pop()
        if isinstance(here, dict | list) and here and id(here) not in seen:
            seen.add(id(here))
            holders.append(here)
            stack.extend(here.values() if isinstance(here, dict) else here[:50])
    if not holders:
        return deepcopy(rng.choice(VALUES))
    # Few lists of numbers are as telling as the fields about them.
    fields = [one for one in holders if isinstance(one, dict)]
    holder = rng.choice(fields) if fields and rng.random() < 0.7 else rng.choice(holders)
    key = rng.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
    kind = rng.random()
    if kind < 0.15:
        del holder[key]
    elif kind < 0.2 and isinstance(holder, dict):
        holder[rng.choice(WORDS)] = holder.pop(key)
    elif kind < 0.25:
        inner: object = 1
        for _ in range(min(depth(rng), 100)):  # texts are nested deeper than Python writes them
            inner = [inner] if rng.random() < 0.5 else {"a": inner}
        holder[key] = inner
    elif kind < 0.35 and isinstance(holder[key], list):
        holder[key] = holder[key] * rng.choice([0, 2, 100]) + [deepcopy(rng.choice(VALUES))]
    elif kind < 0.5:
        there = rng.choice(holders)
        other = rng.choice(list(there.values()) if isinstance(there, dict) else there)
        holder[key] = json.loads(json.dumps(other)) if not isinstance(other, dict | list) else []
    else:
        holder[key] = deepcopy(rng.choice(VALUES))
    return value


def _json(rng: random.Random, data: bytes, other: bytes) -> bytes:
    value = json.loads(data)
    for _ in range(rng.choice([1, 1, 1, 2])):
        value = changed_value(rng, value)
    return json.dumps(value, ensure_ascii=rng.random() < 0.5).encode("utf-8", "surrogatepass")


def _yaml(rng: random.Random, data: bytes, other: bytes) -> bytes:
    value = changed_value(rng, yaml.safe_load(data))
    return yaml.safe_dump(value, allow_unicode=True).encode("utf-8", "surrogatepass")


def _yaml_bomb(rng: random.Random, data: bytes, other: bytes) -> bytes:
    rows = [b"a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    rows += [b"a%d: &a%d [%s]" % (i, i, b", ".join([b"*a%d" % (i - 1)] * 9)) for i in range(1, 12)]
    return b"\n".join(rows) + b"\n" + data


def _attribute(rng: random.Random, data: bytes, other: bytes) -> bytes:
    found = list(_ATTRIBUTE.finditer(data))
    for match in sorted(rng.sample(found, min(len(found), rng.choice([1, 1, 3]))), reverse=True,
                        key=lambda one: one.start()):  # fmt: skip
        values = NUMBERS if rng.random() < 0.7 else WORDS
        text = rng.choice(values).encode("utf-8", "surrogatepass")
        for plain, told in (
            (b"&", b"&amp;"),
            (b"<", b"&lt;"),
            (b'"', b"&quot;"),
            (b"'", b"&apos;"),
        ):
            text = text.replace(plain, told)
        name = match[1] if rng.random() < 0.95 else b"odd"
        data = (
            data[: match.start()] + name + b"=" + match[2] + text + match[2] + data[match.end() :]
        )
    return data


def _element(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """An element lost, doubled, put elsewhere, or a reference to it changed for another's."""
    found = list(_ELEMENT.finditer(data))
    if not found:
        return data
    one, there = rng.choice(found), rng.choice(found)
    kind = rng.randrange(3)
    if kind == 0:
        return data[: one.start()] + data[one.end() :]
    if kind == 1:
        return data[: one.start()] + one[0] * rng.choice([2, 200]) + data[one.end() :]
    return data[: one.start()] + there[0] + data[one.end() :]


def _exchanged(rng: random.Random, data: bytes, other: bytes) -> bytes:
    """Two attributes' values exchanged: references that lead elsewhere."""
    found = list(_ATTRIBUTE.finditer(data))
    if len(found) < 2:
        return data
    one, two = sorted(rng.sample(found, 2), key=lambda match: match.start())
    return (
        data[: one.start(3)] + two[3] + data[one.end(3) : two.start(3)] + one[3]
        + data[two.end(3) :]
    )  # fmt: skip


def _entities(rng: random.Random, data: bytes, other: bytes) -> bytes:
    head, end, rest = data.partition(b"?>")
    body = rest if end else data
    outside = b'<!DOCTYPE a [<!ENTITY k SYSTEM "file:///etc/passwd">]>'
    return head + end + rng.choice([_BOMB, outside]) + body.replace(b">", b">&k;", 2)


_XML = {
    "attribute": _attribute,
    "element": _element,
    "exchanged": _exchanged,
    "entities": _entities,
}


def document_of(  # noqa: PLR0911
    data: bytes,
) -> dict[str, Callable[[random.Random, bytes, bytes], bytes]]:
    """Return what can be done to a document, if this is one."""
    start = data[:200].lstrip()
    if len(data) > _LONGEST:
        return _XML if start[:1] == b"<" else {}
    if start[:1] in (b"{", b"["):
        try:
            json.loads(data)
        except (ValueError, RecursionError):
            return {}
        return {"json": _json, "json again": _json}
    if start[:1] == b"<":
        return _XML
    if re.match(rb"(#[^\n]*\n)*\w+:(\s|$)", start):
        try:
            value = yaml.safe_load(data)
        except (yaml.YAMLError, ValueError, RecursionError):
            return {}
        if isinstance(value, dict):
            return {"yaml": _yaml, "yaml again": _yaml, "yaml bomb": _yaml_bomb}
    return {}
