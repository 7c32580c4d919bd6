"""Between a node and the receiver: delay, lost packets, clocks and poses that are off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.studies.fusion.message import Message
from urbantwin.studies.fusion.nodes import Node
from urbantwin.studies.fusion.packets import lost_packets

__all__ = ["OLDEST_S", "Channel", "as_received", "clock_error_s", "latest"]

#: What is older is thrown away, seconds.
OLDEST_S = 1.0
#: What random numbers are for.
_LOSS, _POSE = 1, 2


@dataclass(frozen=True)
class Channel:
    """How messages come to the receiver, beside what was recorded.

    Attributes:
        latency_s: of every message, seconds.
        clock_error_s: clocks of the nodes are ahead and behind by so much, by turns.
        place_error_m: standard deviation of an error of each node's place, east and north.
        yaw_error_deg: of an error of its heading. Errors are drawn anew for every frame.
        loss: share of the packets that are lost.
        silent: number of a node that sends nothing any more; -1 for none.
        silent_from_s: from when on, seconds of the motion.
    """

    latency_s: float = 0.0
    clock_error_s: float = 0.0
    place_error_m: float = 0.0
    yaw_error_deg: float = 0.0
    loss: float = 0.0
    silent: int = -1
    silent_from_s: float = 0.0


def clock_error_s(channel: Channel, node: Node) -> float:
    """Return how far ahead a node's clock is of what was recorded, seconds."""
    return channel.clock_error_s * (1.0 if node.number % 2 else -1.0)


def latest(node: Node, ego: Node, moment: int, channel: Channel, every: int = 1) -> int | None:
    """Return the moment of the node's frame that the receiver uses: the one that is nearest to now.

    Of the frames that have arrived when the receiver has its own, it is the one whose stamp is
    nearest to the receiver's; none is older than `OLDEST_S`.

    Args:
        node: who sends.
        ego: the receiver.
        moment: of the receiver's frame.
        channel: between the two.
        every: the node sends each so manieth moment.
    """
    mine, ahead = ego.looks[moment], clock_error_s(channel, node)
    best, nearest = None, np.inf
    for number, look in node.looks.items():
        if look.arrival_s is None or number % every:
            continue
        if node.number == channel.silent and look.time_s >= channel.silent_from_s - 1e-9:
            continue
        if look.arrival_s + channel.latency_s > mine.done_s + 1e-9:
            continue
        if look.time_s < mine.time_s - OLDEST_S - 1e-9:
            continue
        off = abs(look.clock_s + ahead - mine.clock_s)
        if off < nearest - 1e-9 or (off < nearest + 1e-9 and (best is None or number > best)):
            best, nearest = number, off
    return best


def as_received(
    messages: Sequence[Message], node: Node, moment: int, channel: Channel, seed: int
) -> list[Message]:
    """Return the messages of one frame as they come: some lost, with errors of clock and pose.

    Args:
        messages: as they were sent, of one codec.
        node: who sent.
        moment: of its frame.
        channel: between the two.
        seed: of all random numbers.
    """
    lost = lost_packets(len(messages), channel.loss, (seed, _LOSS, node.number, moment))
    draw = np.random.default_rng((seed, _POSE, node.number, moment)).standard_normal(3)
    east, north = channel.place_error_m * draw[:2]
    yaw = np.radians(channel.yaw_error_deg) * draw[2]
    ahead = clock_error_s(channel, node)
    turn = rotation_from_ypr(yaw, 0.0, 0.0)
    found = []
    for one, gone in zip(messages, lost, strict=True):
        if gone:
            continue
        pose = one.head.site_SE3_payload
        off = Pose(turn @ pose.rotation, pose.translation + np.array([east, north, 0.0]))
        head = replace(one.head, site_SE3_payload=off, stamp_s=one.head.stamp_s + ahead)
        found.append(replace(one, head=head))
    return found
