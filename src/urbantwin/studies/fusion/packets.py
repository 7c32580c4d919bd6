"""A frame's content in packets, each of which can be decoded without the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from urbantwin.errors import InputError
from urbantwin.studies.fusion.message import HEADER_BYTES, MOST_PAYLOAD, Head, Message, pack

__all__ = ["LEAST_MTU", "MOST_MTU", "in_packets", "lost_packets"]

#: A packet shorter than this has hardly room beside its header, bytes.
LEAST_MTU = 256
#: The longest that a header can tell.
MOST_MTU = HEADER_BYTES + MOST_PAYLOAD
#: So much fuller or emptier a packet is tried when the first guess does not fit.
_SHRINK = 0.97


def in_packets(
    codec: str,
    count: int,
    encoded: Callable[[int, int], bytes],
    mtu: int,
    head: Head,
    flags: int = 0,
) -> list[bytes]:
    """Return the packets of one frame: as many items in each as fit, in their order.

    Args:
        codec: of the payloads.
        count: of the items.
        encoded: returns the payload of items from one number up to another.
        mtu: bytes that a packet may have, header included.
        head: of the frame.
        flags: of the codec.

    Raises:
        InputError: not even one item fits.
    """
    room = min(mtu - HEADER_BYTES, MOST_PAYLOAD)
    payloads: list[bytes] = []
    begin, guess = 0, max(count, 1)
    while begin < count or not payloads:
        size = min(guess, count - begin)
        payload = encoded(begin, begin + size)
        while len(payload) > room:
            if size <= 1:
                raise InputError(
                    f"one item of codec {codec} takes {len(payload)} bytes",
                    place="--mtu",
                    expected=f"at least {len(payload) + HEADER_BYTES} bytes",
                )
            size = max(1, min(size - 1, int(size * _SHRINK * room / len(payload))))
            payload = encoded(begin, begin + size)
        payloads.append(payload)
        begin += size
        # The next is as dense as this one, about: a first guess that is a little too full.
        guess = max(1, int(size * room / max(len(payload), 1)))
    return [
        pack(Message(head, codec, number, len(payloads), one, flags))
        for number, one in enumerate(payloads)
    ]


def lost_packets(count: int, share: float, key: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return which of some packets are lost, each on its own with the same chance.

    Packets that are lost at some share are lost at every greater one, too.

    Args:
        count: of packets.
        share: 0..1, how likely each is lost.
        key: what the draws follow from: the seed, the node, the frame.
    """
    return np.asarray(np.random.default_rng(key).random(count) < share)
