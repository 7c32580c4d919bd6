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
    """Errors and delays of messages to the receiver, in addition to the recorded ones.

    Attributes:
        latency_s: latency added to every message, seconds.
        clock_error_s: error of the node clocks, seconds; positive and negative alternately.
        place_error_m: standard deviation of the error of each node's position, east and north.
        yaw_error_deg: standard deviation of the heading error. Errors are drawn anew for every
            frame.
        loss: share of the packets that are lost.
        silent: number of a node that stops sending; -1 for none.
        silent_from_s: time from which that node is silent, seconds of the motion.
    """

    latency_s: float = 0.0
    clock_error_s: float = 0.0
    place_error_m: float = 0.0
    yaw_error_deg: float = 0.0
    loss: float = 0.0
    silent: int = -1
    silent_from_s: float = 0.0

    def ahead_s(self, node: Node) -> float:
        """Return the offset of a node's clock from the recorded time, seconds."""
        return self.clock_error_s * (1.0 if node.number % 2 else -1.0)


def latest(node: Node, ego: Node, moment: int, channel: Channel, every: int = 1) -> int | None:
    """Return the moment of the node's frame that the receiver uses; ``None`` if there is none.

    Among the frames that have arrived when the receiver's frame is complete, it is the frame with
    the time stamp closest to the receiver's. Frames older than `OLDEST_S` are not used.

    Args:
        node: the sender.
        ego: the receiver.
        moment: moment of the receiver's frame.
        channel: channel between the two.
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
    """Return a frame without lost packets, with clock and pose errors; ``None`` if all are lost.

    Packets lost at a certain loss share are also lost at every greater share.

    Args:
        message: message of the node.
        node: the sender.
        moment: moment of its frame.
        channel: channel between the two.
        seed: seed of all random numbers.
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
