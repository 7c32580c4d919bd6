"""Boxes in packets: what a node detected, how fast it goes, and how well that is known.

A box is 16 bytes: class, score in 255ths, place in centimetres (int16 each), sizes in centimetres
(uint16 each), yaw in 2 pi / 65536. With motion 4 more: of people the velocity in x and y, of all
others speed and rate of turn (cm/s and mrad/s, int16). With covariance 14 more (float16): that of
x with x, x with y and y with y, and the variances of z, yaw and the two rates.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.geometry import Pose, wrapped
from urbantwin.studies.fusion.message import Head, Message
from urbantwin.studies.fusion.packets import in_packets
from urbantwin.studies.fusion.payload import bad_payload, compressed, decompressed, unpacked

__all__ = ["Boxes", "box_packets", "boxes_of_payload", "joined_boxes", "moved_boxes"]

_HEAD = struct.Struct("<HB")
_MOTION, _COVARIANCE, _COMPRESSED = 1, 2, 4
_BOX = [("kind", "u1"), ("score", "u1"), ("place", "<i2", 3), ("size", "<u2", 3), ("yaw", "<i2")]
_TURN = 32768 / np.pi
#: Standard deviations that nobody told: place, height, yaw, speed, rate of turn (or speed).
_NOT_TOLD = (0.5, 0.3, 0.3, 5.0, 1.0)


@dataclass(frozen=True, eq=False)
class Boxes:
    """What a node knows of road users at one moment.

    Attributes:
        box: (N, 7) centre, length, width, height, yaw, in metres and radians.
        kind: (N,) int64, numbers in ``DETECTED_CLASSES``.
        score: (N,) float64, 0..1.
        rates: (N, 2) of people the velocity in x and y, m/s; of others the speed along the
            heading, m/s, and the rate of turn, rad/s, as `tracking.kalman` has them.
        covariance: (N, 6, 6) of x, y, z, yaw and the two rates.
    """

    box: NDArray[np.float64]
    kind: NDArray[np.int64]
    score: NDArray[np.float64]
    rates: NDArray[np.float64]
    covariance: NDArray[np.float64]

    def __len__(self) -> int:
        """Return how many there are."""
        return len(self.box)

    def only(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> Boxes:
        """Return some of them."""
        return Boxes(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @property
    def walks(self) -> NDArray[np.bool_]:
        """Which of them (N,) step to any side: people."""
        return np.asarray(self.kind == DETECTED_CLASSES.index("pedestrian"))

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocities (N, 2) in x and y, m/s."""
        ahead = np.column_stack([np.cos(self.box[:, 6]), np.sin(self.box[:, 6])])
        return np.where(self.walks[:, None], self.rates, self.rates[:, :1] * ahead)


def joined_boxes(parts: list[Boxes]) -> Boxes:
    """Return the boxes of several as one."""
    if not parts:
        none = np.zeros((0, 7)), np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 2))
        return Boxes(*none, np.zeros((0, 6, 6)))
    names = Boxes.__dataclass_fields__
    return Boxes(*(np.concatenate([getattr(one, name) for one in parts]) for name in names))


def moved_boxes(boxes: Boxes, outer_SE3_inner: Pose) -> Boxes:
    """Return boxes in another frame; they stay upright, and what is known of them turns along."""
    box, turn = boxes.box.copy(), outer_SE3_inner.rotation
    box[:, :3] = outer_SE3_inner.apply(box[:, :3])
    ahead = np.column_stack([np.cos(box[:, 6]), np.sin(box[:, 6]), np.zeros(len(box))]) @ turn.T
    box[:, 6] = np.arctan2(ahead[:, 1], ahead[:, 0])
    level = np.arctan2(turn[1, 0], turn[0, 0])
    c, s = np.cos(level), np.sin(level)
    plan = np.array([[c, -s], [s, c]])
    rates = np.where(boxes.walks[:, None], boxes.rates @ plan.T, boxes.rates)
    covariance = np.tile(np.eye(6), (len(box), 1, 1))
    covariance[:, :2, :2] = plan
    covariance[boxes.walks, 4:, 4:] = plan
    covariance = covariance @ boxes.covariance @ covariance.transpose(0, 2, 1)
    return replace(boxes, box=box, rates=rates, covariance=covariance)


def box_packets(
    boxes: Boxes,
    mtu: int,
    head: Head,
    *,
    motion: bool = True,
    covariance: bool = True,
    codec: str = "boxes",
) -> list[bytes]:
    """Return boxes as packets.

    Args:
        boxes: in the frame of the payload, at most 327 m from its origin.
        mtu: bytes that a packet may have.
        head: of the frame.
        motion: tell how fast they go.
        covariance: tell how well places and motions are known.
        codec: ``boxes``; ``moving`` where they are told only to move what else was sent.
    """
    flags = _MOTION * motion + _COVARIANCE * covariance
    rows = np.zeros(len(boxes), _row(flags))
    rows["kind"] = boxes.kind
    rows["score"] = np.rint(255 * np.clip(boxes.score, 0, 1))
    rows["place"] = np.rint(np.clip(boxes.box[:, :3], -327, 327) * 100)
    rows["size"] = np.rint(np.clip(boxes.box[:, 3:6], 0.01, 655) * 100)
    rows["yaw"] = (
        (np.rint(wrapped(boxes.box[:, 6]) * _TURN).astype(np.int64) & 0xFFFF)
        .astype("<u2")
        .view("<i2")
    )
    if motion:
        unit = np.where(boxes.walks[:, None], 100.0, [100.0, 1000.0])
        rows["rates"] = np.rint(np.clip(boxes.rates * unit, -32767, 32767))
    if covariance:
        known = boxes.covariance
        diagonal = known[:, range(2, 6), range(2, 6)]
        spread = np.column_stack([known[:, 0, 0], known[:, 0, 1], known[:, 1, 1], diagonal])
        rows["known"] = np.clip(spread, -6e4, 6e4)

    def encoded(begin: int, end: int) -> bytes:
        plain = rows[begin:end].tobytes()
        packed = compressed(plain)
        less = len(packed) < len(plain)
        count = min(end - begin, 65_535)
        return _HEAD.pack(count, flags | _COMPRESSED * less) + (packed if less else plain)

    return in_packets(
        codec,
        len(boxes),
        encoded,
        mtu,
        head,
    )


def boxes_of_payload(message: Message) -> Boxes:
    """Return the boxes of one packet in the frame of the payload.

    Where motion is not told they stand; where covariance is not told, it is a usual one.

    Raises:
        InputError: the payload is not what the codec writes.
    """
    if message.codec not in ("boxes", "moving"):
        raise bad_payload(f"is of codec {message.codec}, which tells no boxes")
    (count, flags), rest = unpacked(_HEAD, message.payload)
    count, flags = int(count), int(flags)
    form = np.dtype(_row(flags))
    size = count * form.itemsize
    plain = decompressed(rest, size) if flags & _COMPRESSED else rest
    if len(plain) != size:
        raise bad_payload(f"has {len(plain)} bytes for {count} boxes")
    rows = np.frombuffer(plain, form)
    kind = rows["kind"].astype(np.int64)
    if (kind >= len(DETECTED_CLASSES)).any() or (rows["size"] == 0).any():
        raise bad_payload("has a box of an unknown class or without extent")
    box = np.column_stack([rows["place"] / 100.0, rows["size"] / 100.0, rows["yaw"] / _TURN])
    rates = np.zeros((count, 2))
    found = Boxes(box, kind, rows["score"] / 255.0, rates, np.zeros((count, 6, 6)))
    if flags & _MOTION:
        unit = np.where(found.walks[:, None], 100.0, [100.0, 1000.0])
        rates[:] = rows["rates"] / unit
    place, height, yaw, speed, turn = np.square(_NOT_TOLD)
    last = np.where(found.walks, speed, turn)
    spread = np.column_stack(
        [np.full((count, 5), [place, 0.0, place, height, yaw]), np.full(count, speed), last]
    )
    if flags & _COVARIANCE:
        spread = rows["known"].astype(np.float64)
        sound = (spread[:, [0, 2, 3, 4, 5, 6]] > 0).all(axis=1) & np.isfinite(spread).all(axis=1)
        if not (sound & (spread[:, 0] * spread[:, 2] > spread[:, 1] ** 2)).all():
            raise bad_payload("has a covariance that none can be")
    covariance = found.covariance
    covariance[:, 0, 0], covariance[:, 1, 1] = spread[:, 0], spread[:, 2]
    covariance[:, 0, 1] = covariance[:, 1, 0] = spread[:, 1]
    covariance[:, range(2, 6), range(2, 6)] = spread[:, 3:]
    return found


def _row(flags: int) -> list[tuple[str, str] | tuple[str, str, int]]:
    fields: list[tuple[str, str] | tuple[str, str, int]] = list(_BOX)  # type: ignore[arg-type]
    if flags & _MOTION:
        fields.append(("rates", "<i2", 2))
    if flags & _COVARIANCE:
        fields.append(("known", "<f2", 7))
    return fields
