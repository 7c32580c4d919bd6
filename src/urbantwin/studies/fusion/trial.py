"""One moment under every setting: what is sent, what comes, and what the receiver then detects."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.errors import InputError
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose
from urbantwin.learn.decoding import Found
from urbantwin.learn.detecting import found_in
from urbantwin.learn.frames import levelled
from urbantwin.learn.model import Model
from urbantwin.studies.fusion.advance import advanced_boxes, advanced_points, moving_of
from urbantwin.studies.fusion.box_codec import (
    Boxes,
    box_packets,
    boxes_of_payload,
    joined_boxes,
    moved_boxes,
)
from urbantwin.studies.fusion.box_fusion import fused_boxes
from urbantwin.studies.fusion.channel import Channel, as_received, latest
from urbantwin.studies.fusion.feature_codec import (
    FeatureMap,
    feature_packets,
    features_of_payload,
)
from urbantwin.studies.fusion.feature_maps import (
    Encoded,
    chosen_cells,
    detected_in_cells,
    encoded,
    merged,
    warped,
)
from urbantwin.studies.fusion.message import Head, Message, bits_of, unpack
from urbantwin.studies.fusion.nodes import Look, Node, Nodes
from urbantwin.studies.fusion.own_view import local_pose
from urbantwin.studies.fusion.point_codecs import (
    PointCodec,
    Points,
    cloud_of_payload,
    cloud_packets,
)
from urbantwin.studies.fusion.setting import Alone, Early, Late, Middle, Setting

__all__ = ["Outcome", "Trial"]

#: So many are kept of what is made: many of what is small or made of parts.
_MOST = {"points": 4000, "cells": 4000, "frame": 24, "encoded": 24, "moving": 200, "boxes": 200,
         "early": 200, "middle": 200, "cloud": 60, "features": 60}  # fmt: skip
_Made = TypeVar("_Made")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What became of a setting at one moment.

    Attributes:
        box: (N, 7) detected, in the site.
        kind: (N,) numbers in ``DETECTED_CLASSES``.
        score: (N,) 0..1.
        bits: of all messages that the receiver used, as they were sent.
        bits_s: of them a second, as every node sends at its own rate.
        packets: how many these were.
        age_s: of what was used, the mean of the nodes; NaN where nothing was.
    """

    box: NDArray[np.float64]
    kind: NDArray[np.int64]
    score: NDArray[np.float64]
    bits: float
    bits_s: float
    packets: float
    age_s: float


@dataclass(frozen=True, eq=False)
class _Sent:
    """The messages of one node's frame: their bytes, and what decoding them gave."""

    packets: list[bytes]
    messages: list[Message]
    rate_hz: float


class Trial:
    """Settings at moments.

    Args:
        model: the detector.
        identity: eight bytes that tell it from others.
        nodes: the receiver first.
        seen: what each node detects alone, by its number and the moment, in its local frame.
        mtu: bytes of a packet.
        seed: of all random numbers.
        least: boxes that are less likely are left out.
    """

    def __init__(
        self,
        model: Model,
        identity: bytes,
        nodes: Nodes,
        seen: Mapping[int, Mapping[int, Boxes]],
        *,
        mtu: int,
        seed: int,
        least: float,
    ) -> None:
        self._model, self._identity, self._nodes, self._seen = model, identity, nodes, seen
        self._mtu, self._seed, self._least = mtu, seed, least
        self._made: dict[tuple[object, ...], object] = {}

    def outcomes(self, moment: int, settings: Sequence[Setting]) -> list[Outcome]:
        """Return what becomes of each setting at a moment at which the receiver has a frame.

        Raises:
            InputError: a file of a frame is bad, or packets are too small.
        """
        done: dict[tuple[object, ...], Outcome] = {}
        for one in settings:
            if one.work not in done:
                done[one.work] = self._outcome(moment, one)
        return [done[one.work] for one in settings]

    def _outcome(self, moment: int, setting: Setting) -> Outcome:
        how, nodes = setting.how, self._nodes
        others = nodes.nodes[1 : setting.nodes]
        mine = nodes.ego.looks[moment]
        used: list[tuple[_Sent, float]] = []
        if isinstance(how, Alone):
            found = self._own(moment)
        elif isinstance(how, Early):
            found, used = self._early(moment, others, setting, how)
        elif isinstance(how, Middle):
            found, used = self._middle(moment, others, setting, how)
        else:
            found, used = self._late(moment, others, setting, how)
        # Judged where the receiver is, not where it believes to be.
        off = mine.true @ mine.reported.inverse()
        boxes = joined_boxes([])
        count = len(found.box)
        rest = np.zeros((count, 2)), np.zeros((count, 6, 6))
        boxes = moved_boxes(Boxes(found.box, found.number, found.score, *rest), off)
        every = how.every if isinstance(how, Late) else 1
        return Outcome(
            box=boxes.box,
            kind=boxes.kind,
            score=boxes.score,
            bits=sum(bits_of(sent.packets) for sent, _ in used) / every,
            bits_s=sum(bits_of(sent.packets) * sent.rate_hz for sent, _ in used) / every,
            packets=sum(len(sent.packets) for sent, _ in used) / every,
            age_s=float(np.mean([age for _, age in used])) if used else float("nan"),
        )

    def _own(self, moment: int) -> Found:
        ego = self._nodes.ego
        boxes = moved_boxes(self._seen[ego.number][moment], self._local(ego, moment))
        return Found(boxes.box, boxes.kind, boxes.score)

    def _early(
        self, moment: int, others: Sequence[Node], setting: Setting, how: Early
    ) -> tuple[Found, list[tuple[_Sent, float]]]:
        ego = self._nodes.ego
        frame, look = self._frame(ego, moment), ego.looks[moment]
        tells = self._model.design.intensity
        clouds = [(look.reported.apply(frame.points), frame.intensity if tells else None)]
        used: list[tuple[_Sent, float]] = []
        for node in others:
            at = latest(node, ego, moment, setting.channel)
            if at is None:
                continue
            sent = self._cloud(node, at, how.codec)
            used.append((sent, self._age(node, at, moment)))
            came = as_received(sent.messages, node, at, setting.channel, self._seed)
            moved = None
            if setting.aligned:
                moved = self._moved(node, at, moment, setting.channel, used)
            for one in came:
                points = self._kept(
                    ("points", node.number, at, how.codec, one.packet),
                    lambda one=one: cloud_of_payload(one),  # type: ignore[misc]
                )
                place = one.head.site_SE3_payload.apply(points.place)
                if moved is not None:
                    place = advanced_points(place, *moved)
                clouds.append((place, points.intensity))
        intensity = None
        if tells:
            intensity = np.concatenate(
                [np.zeros(len(place)) if one is None else one for place, one in clouds]
            )
        whole = Frame(
            np.concatenate([place for place, _ in clouds]),
            intensity=intensity,
            sensor_places=look.reported.apply(frame.sensor_places),
        )
        key = hashlib.sha256(whole.points.tobytes()).digest()
        found = self._kept(
            ("early", moment, key), lambda: found_in(self._model, whole, least=self._least)[0]
        )
        return self._of_model(found), used

    def _middle(
        self, moment: int, others: Sequence[Node], setting: Setting, how: Middle
    ) -> tuple[Found, list[tuple[_Sent, float]]]:
        ego = self._nodes.ego
        mine = self._encoded(ego, moment, along_site=True)
        told: list[tuple[NDArray[np.int64], NDArray[np.float32]]] = []
        used: list[tuple[_Sent, float]] = []
        for node in others:
            at = latest(node, ego, moment, setting.channel)
            if at is None:
                continue
            sent = self._features(node, at, how)
            used.append((sent, self._age(node, at, moment)))
            came = as_received(sent.messages, node, at, setting.channel, self._seed)
            moved = None
            if setting.aligned:
                moved = self._moved(node, at, moment, setting.channel, used)
            parts = [
                self._kept(
                    ("cells", node.number, at, how, one.packet),
                    lambda one=one: self._of_this_model(features_of_payload(one)),  # type: ignore[misc]
                )
                for one in came
            ]
            if parts:
                whole = replace(
                    parts[0],
                    cell=np.concatenate([one.cell for one in parts]),
                    values=np.concatenate([one.values for one in parts]),
                )
                told.append(warped(whole, came[0].head.site_SE3_payload, mine, moved))
        canvas = merged(mine, told)
        key = hashlib.sha256(canvas.tobytes()).digest()
        found = self._kept(
            ("middle", moment, key),
            lambda: detected_in_cells(self._model, mine, canvas, self._least),
        )
        return self._of_model(found), used

    def _late(
        self, moment: int, others: Sequence[Node], setting: Setting, how: Late
    ) -> tuple[Found, list[tuple[_Sent, float]]]:
        ego = self._nodes.ego
        parts = [moved_boxes(self._seen[ego.number][moment], self._local(ego, moment))]
        used: list[tuple[_Sent, float]] = []
        for node in others:
            at = latest(node, ego, moment, setting.channel, how.every)
            if at is None:
                continue
            sent = self._boxes(node, at, how)
            used.append((sent, self._age(node, at, moment)))
            came = as_received(sent.messages, node, at, setting.channel, self._seed)
            for one in came:
                boxes = moved_boxes(boxes_of_payload(one), one.head.site_SE3_payload)
                if setting.aligned:
                    boxes = advanced_boxes(boxes, ego.looks[moment].clock_s - one.head.stamp_s)
                parts.append(boxes)
        fused = fused_boxes(parts, how.rule)
        return Found(fused.box, fused.kind, fused.score), used

    def _moved(
        self,
        node: Node,
        at: int,
        moment: int,
        channel: Channel,
        used: list[tuple[_Sent, float]],
    ) -> tuple[Boxes, Boxes] | None:
        """Return the road users that a node says move, when it looked and now, in the site."""
        sent = self._moving(node, at)
        used.append((sent, self._age(node, at, moment)))
        came = as_received(sent.messages, node, at, channel, self._seed)
        if not came:
            return None
        told = [moved_boxes(boxes_of_payload(one), one.head.site_SE3_payload) for one in came]
        before = joined_boxes(told)
        seconds = self._nodes.ego.looks[moment].clock_s - came[0].head.stamp_s
        return before, advanced_boxes(before, seconds)

    def _cloud(self, node: Node, at: int, codec: PointCodec) -> _Sent:
        def make() -> list[bytes]:
            frame, look = self._frame(node, at), node.looks[at]
            design = self._model.design
            frame_SE3_local, site_SE3_local = local_pose(frame, look)
            # What no detector of this range looks at is not sent: far points, crowns, wires.
            kept = levelled(frame, design.range_m).kept
            place = frame_SE3_local.inverse().apply(frame.points[kept])
            tells = design.intensity and frame.intensity is not None
            points = Points(place, frame.intensity[kept] if tells else None)  # type: ignore[index]
            return cloud_packets(points, codec, self._mtu, self._head(node, at, site_SE3_local))

        return self._sent(node, ("cloud", node.number, at, codec), make)

    def _features(self, node: Node, at: int, how: Middle) -> _Sent:
        def make() -> list[bytes]:
            known = self._encoded(node, at, along_site=how.along_site)
            told = chosen_cells(known, how.cells, how.stride, self._identity)
            channels = told.values.shape[1] if how.channels is None else how.channels
            head = self._head(node, at, known.site_SE3_map)
            return feature_packets(told, how.bits, channels, self._mtu, head)

        return self._sent(node, ("features", node.number, at, how), make)

    def _boxes(self, node: Node, at: int, how: Late) -> _Sent:
        def make() -> list[bytes]:
            boxes = self._seen[node.number][at]
            boxes = boxes.only(boxes.score >= how.least)
            head = self._head(node, at, self._local(node, at))
            return box_packets(boxes, self._mtu, head, motion=how.motion, covariance=how.covariance)

        key = (how.least, how.motion, how.covariance)
        return self._sent(node, ("boxes", node.number, at, *key), make)

    def _moving(self, node: Node, at: int) -> _Sent:
        def make() -> list[bytes]:
            boxes = self._seen[node.number][at]
            boxes = boxes.only(moving_of(boxes))
            head = self._head(node, at, self._local(node, at))
            return box_packets(boxes, self._mtu, head, covariance=False, codec="moving")

        return self._sent(node, ("moving", node.number, at), make)

    def _head(self, node: Node, at: int, site_SE3_payload: Pose) -> Head:
        return Head(node.number, at, node.looks[at].clock_s, site_SE3_payload)

    def _sent(self, node: Node, key: tuple[object, ...], make: Callable[[], list[bytes]]) -> _Sent:
        def whole() -> _Sent:
            packets = make()
            return _Sent(packets, [unpack(one) for one in packets], node.rate_hz)

        return self._kept(key, whole)

    def _encoded(self, node: Node, at: int, *, along_site: bool) -> Encoded:
        def make() -> Encoded:
            look = node.looks[at]
            frame = self._frame(node, at)
            return encoded(self._model, frame, look.reported, along_site=along_site)

        return self._kept(("encoded", node.number, at, along_site), make)

    def _frame(self, node: Node, at: int) -> Frame:
        return self._kept(("frame", node.number, at), lambda: node.frame(at))

    def _local(self, node: Node, at: int) -> Pose:
        return local_pose(self._frame(node, at), node.looks[at])[1]

    def _age(self, node: Node, at: int, moment: int) -> float:
        return self._look(moment).time_s - node.looks[at].time_s

    def _look(self, moment: int) -> Look:
        return self._nodes.ego.looks[moment]

    def _of_model(self, found: Found) -> Found:
        """Return what a model finds with the numbers of ``DETECTED_CLASSES``."""
        names = self._model.design.classes
        number = np.array([DETECTED_CLASSES.index(one) for one in names], np.int64)
        return Found(found.box, number[found.number], found.score)

    def _of_this_model(self, told: FeatureMap) -> FeatureMap:
        """Refuse features of another model.

        Raises:
            InputError: they are.
        """
        if told.model != self._identity:
            raise InputError(
                f"has features of model {told.model.hex()}",
                place="message",
                expected=f"those of model {self._identity.hex()}, which the receiver runs",
            )
        return told

    def _kept(self, key: tuple[object, ...], make: Callable[[], _Made]) -> _Made:
        """Return what was made for a key, or make it; what was used longest ago is forgotten."""
        if key not in self._made:
            self._made[key] = make()
            alike = [one for one in self._made if one[0] == key[0]]
            for old in alike[: -_MOST[str(key[0])]]:
                del self._made[old]
        else:
            self._made[key] = self._made.pop(key)
        return self._made[key]  # type: ignore[return-value]
