"""Between a node and the receiver: delay, lost packets, clocks and poses that are off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urbantwin.geometry import Pose, rotation_from_ypr
from urbantwin.studies.fusion.messages import Content, Sent
from urbantwin.studies.fusion.nodes import Node

__all__ = ["OLDEST_S", "Channel", "latest", "received"]

#: Older frames are thrown away, seconds.
OLDEST_S = 1.0
#: Streams of random numbers.
_LOSS, _POSE = 1, 2


@dataclass(frozen=True)
class Channel:
    """How messages come to the receiver, beside what was recorded.

    Attributes:
        latency_s: of every message, seconds.
        clock_error_s: clocks of the nodes are ahead and behind by this much, by turns.
        place_error_m: standard deviation of an error of each node's place, east and north.
        yaw_error_deg: of an error of its heading. Errors are drawn anew for every frame.
        loss: share of the packets that are lost.
        silent: number of a node that stops sending; -1 for none.
        silent_from_s: from when on, seconds of the motion.
    """

    latency_s: float = 0.0
    clock_error_s: float = 0.0
    place_error_m: float = 0.0
    yaw_error_deg: float = 0.0
    loss: float = 0.0
    silent: int = -1
    silent_from_s: float = 0.0

    def ahead_s(self, node: Node) -> float:
        """Return how far ahead a node's clock is of what was recorded, seconds."""
        return self.clock_error_s * (1.0 if node.number % 2 else -1.0)


def latest(node: Node, ego: Node, moment: int, channel: Channel, every: int = 1) -> int | None:
    """Return the moment of the node's frame that the receiver uses; None where there is none.

    Of the frames that have arrived when the receiver has its own, it is the one whose stamp is
    nearest to the receiver's; none is older than `OLDEST_S`.

    Args:
        node: the sender.
        ego: the receiver.
        moment: of the receiver's frame.
        channel: between the two.
        every: the node sends every n-th moment.
    """
    mine, ahead = ego.looks[moment], channel.ahead_s(node)
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


def received(
    message: Sent[Content], node: Node, moment: int, channel: Channel, seed: int
) -> Sent[Content] | None:
    """Return a frame without lost packets, with errors of clock and pose; None if all are lost.

    Packets that are lost at some share are lost at every greater one, too.

    Args:
        message: of the node.
        node: the sender.
        moment: of its frame.
        channel: between the two.
        seed: of all random numbers.
    """
    draw = np.random.default_rng((seed, _LOSS, node.number, moment))
    lost = draw.random(len(message.sizes)) < channel.loss
    if lost.all():
        return None
    content, packet = message.content, message.packet
    if lost.any():
        there = ~lost[packet]
        content, packet = content.only(there), packet[there]
    off = np.random.default_rng((seed, _POSE, node.number, moment)).standard_normal(3)
    turn = rotation_from_ypr(np.radians(channel.yaw_error_deg) * off[2], 0.0, 0.0)
    shift = np.array([*(channel.place_error_m * off[:2]), 0.0])
    pose = message.site_SE3_content
    return replace(
        message,
        content=content,
        packet=packet,
        site_SE3_content=Pose(turn @ pose.rotation, pose.translation + shift),
        stamp_s=message.stamp_s + channel.ahead_s(node),
    )
