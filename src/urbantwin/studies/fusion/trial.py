"""Trial of one moment under every setting: transmission, reception, and detection."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from urbantwin.detections import DETECTED_CLASSES
from urbantwin.fidelity.frame import Frame
from urbantwin.geometry import Pose
from urbantwin.learn.decoding import Found
from urbantwin.learn.detecting import found_in
from urbantwin.learn.frames import levelled
from urbantwin.learn.model import Model
from urbantwin.studies.fusion.box_fusion import fused_boxes
from urbantwin.studies.fusion.boxes import (
    Boxes,
    advanced_boxes,
    advanced_points,
    moved_boxes,
    moving_of,
    standing_boxes,
)
from urbantwin.studies.fusion.channel import latest, received
from urbantwin.studies.fusion.feature_maps import (
    Encoded,
    chosen_cells,
    detected_in_cells,
    encoded,
    merged,
    warped,
)
from urbantwin.studies.fusion.messages import (
    Points,
    Sent,
    quantised_boxes,
    quantised_cloud,
    quantised_features,
    sent,
)
from urbantwin.studies.fusion.nodes import Node, Nodes
from urbantwin.studies.fusion.own_view import local_pose
from urbantwin.studies.fusion.setting import Alone, Early, How, Late, Middle, Setting

__all__ = ["Outcome", "Trial"]

_Made = TypeVar("_Made")
#: Moving road users in the site frame: at the node's frame time, and now.
_Moved = tuple[Boxes, Boxes] | None


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a setting at one moment.

    Attributes:
        box: (N, 7) detected boxes, in the site frame.
        kind: (N,) numbers in ``DETECTED_CLASSES``.
        score: (N,) 0..1.
        bits: bits of all messages used by the receiver, as sent.
        bits_s: bits per second, with each node at its own rate.
        packets: number of their packets.
        age_s: mean age of the used frames over the nodes, seconds; NaN without any.
    """

    box: NDArray[np.float64]
    kind: NDArray[np.int64]
    score: NDArray[np.float64]
    bits: float
    bits_s: float
    packets: float
    age_s: float


class Trial:
    """Trials of settings at moments.

    Args:
        model: the detector.
        nodes: the nodes; the receiver first.
        seen: detections of each node alone, by its number and the moment, in its local frame.
        mtu: largest size of a packet, bytes.
        seed: random seed.
        least: lowest score of a box.
    """

    def __init__(
        self,
        model: Model,
        nodes: Nodes,
        seen: Mapping[int, Mapping[int, Boxes]],
        *,
        mtu: int,
        seed: int,
        least: float,
    ) -> None:
        self._model, self._nodes, self._seen = model, nodes, seen
        self._mtu, self._seed, self._least = mtu, seed, least
        self._made: dict[tuple[object, ...], Any] = {}

    def outcomes(self, moment: int, settings: Sequence[Setting]) -> list[Outcome]:
        """Return the result of each setting at a moment with a frame of the receiver.

        Raises:
            InputError: a file of a frame is damaged, or packets are too small.
        """
        self._made.clear()
        done: dict[tuple[object, ...], Outcome] = {}
        for one in settings:
            if one.work not in done:
                done[one.work] = self._outcome(moment, one)
        return [done[one.work] for one in settings]

    def _outcome(self, moment: int, setting: Setting) -> Outcome:
        how, look = setting.how, self._nodes.ego.looks[moment]
        used: list[tuple[Node, Sent[Any], float]] = []
        came = self._received(moment, setting, used)
        if isinstance(how, Alone):
            found = self._own(moment)
        elif isinstance(how, Early):
            found = self._early(moment, came)
        elif isinstance(how, Middle):
            found = self._middle(moment, came)
        else:
            found = fused_boxes([self._own(moment), *self._late(moment, came, setting)], how.rule)
        # Evaluated at the receiver's true pose, not at the reported one.
        boxes = moved_boxes(found, look.true @ look.reported.inverse())
        every = how.every if isinstance(how, Late) else 1
        return Outcome(
            box=boxes.box,
            kind=boxes.kind,
            score=boxes.score,
            bits=sum(one.bits for _, one, _ in used) / every,
            bits_s=sum(one.bits * node.rate_hz for node, one, _ in used) / every,
            packets=sum(len(one.sizes) for _, one, _ in used) / every,
            age_s=float(np.mean([age for _, _, age in used])) if used else float("nan"),
        )

    def _received(
        self, moment: int, setting: Setting, used: list[tuple[Node, Sent[Any], float]]
    ) -> Iterator[tuple[Sent[Any], _Moved]]:
        """Yield the received message of every other node, and its moving road users.

        All messages, with nodes and ages, are added to ``used``, whether received or not.
        """
        how, ego, channel = setting.how, self._nodes.ego, setting.channel
        for node in () if isinstance(how, Alone) else self._nodes.nodes[1 : setting.nodes]:
            at = latest(node, ego, moment, channel, how.every if isinstance(how, Late) else 1)
            if at is None:
                continue
            age = ego.looks[moment].time_s - node.looks[at].time_s
            used.append((node, message := self._sent(node, at, how), age))
            moved = None
            if setting.aligned and not isinstance(how, Late):
                used.append((node, moving := self._moving(node, at), age))
                if told := received(moving, node, at, channel, self._seed):
                    before = moved_boxes(told.content, told.site_SE3_content)
                    seconds = ego.looks[moment].clock_s - told.stamp_s
                    moved = before, advanced_boxes(before, seconds)
            if came := received(message, node, at, channel, self._seed):
                yield came, moved

    def _own(self, moment: int) -> Boxes:
        ego = self._nodes.ego
        return moved_boxes(self._seen[ego.number][moment], self._local(ego, moment))

    def _early(self, moment: int, came: Iterator[tuple[Sent[Any], _Moved]]) -> Boxes:
        ego = self._nodes.ego
        frame, look = self._frame(ego, moment), ego.looks[moment]
        clouds = [Points(look.reported.apply(frame.points), frame.intensity)]
        for message, moved in came:
            place = message.site_SE3_content.apply(message.content.place)
            if moved is not None:
                place = advanced_points(place, *moved)
            clouds.append(Points(place, message.content.intensity))
        intensity = None
        if self._model.design.intensity:
            intensity = np.concatenate(
                [np.zeros(len(k.place)) if k.intensity is None else k.intensity for k in clouds]
            )
        whole = Frame(
            np.concatenate([one.place for one in clouds]),
            intensity=intensity,
            sensor_places=look.reported.apply(frame.sensor_places),
        )
        key = hashlib.sha256(whole.points.tobytes()).digest()
        return self._kept(
            ("early", key),
            lambda: self._of_model(found_in(self._model, whole, least=self._least)[0]),
        )

    def _middle(self, moment: int, came: Iterator[tuple[Sent[Any], _Moved]]) -> Boxes:
        mine = self._encoded(self._nodes.ego, moment, along_site=True)
        canvas = merged(mine, [warped(k.content, k.site_SE3_content, mine, m) for k, m in came])
        key = hashlib.sha256(canvas.tobytes()).digest()
        return self._kept(
            ("middle", key),
            lambda: self._of_model(detected_in_cells(self._model, mine, canvas, self._least)),
        )

    def _late(
        self, moment: int, came: Iterator[tuple[Sent[Any], _Moved]], setting: Setting
    ) -> Iterator[Boxes]:
        clock_s = self._nodes.ego.looks[moment].clock_s
        for message, _ in came:
            boxes = moved_boxes(message.content, message.site_SE3_content)
            yield advanced_boxes(boxes, clock_s - message.stamp_s) if setting.aligned else boxes

    def _sent(self, node: Node, at: int, how: How) -> Sent[Any]:
        def make() -> Sent[Any]:
            clock_s = node.looks[at].clock_s
            if isinstance(how, Middle):
                known = self._encoded(node, at, along_site=how.along_site)
                cells = chosen_cells(known, how.cells, how.stride)
                channels = cells.values.shape[1] if how.channels is None else how.channels
                features = quantised_features(cells, how.bits, channels)
                return sent(features, self._mtu, known.site_SE3_map, clock_s)
            if isinstance(how, Early):
                cloud = quantised_cloud(self._cloud(node, at), how.edge_m)
                return sent(cloud, self._mtu, self._local(node, at), clock_s)
            assert isinstance(how, Late)
            boxes = self._seen[node.number][at]
            boxes = boxes.only(boxes.score >= how.least)
            content = quantised_boxes(boxes, motion=how.motion, covariance=how.covariance)
            return sent(content, self._mtu, self._local(node, at), clock_s)

        return self._kept(("sent", node.number, at, how), make)

    def _cloud(self, node: Node, at: int) -> Points:
        """Return a node's points within the detector's range, in its local frame."""
        frame, design = self._frame(node, at), self._model.design
        local_SE3_frame = local_pose(frame, node.looks[at])[0].inverse()
        kept = levelled(frame, design.range_m).kept
        place = local_SE3_frame.apply(frame.points[kept])
        if not design.intensity or frame.intensity is None:
            return Points(place)
        return Points(place, frame.intensity[kept])

    def _moving(self, node: Node, at: int) -> Sent[Boxes]:
        def make() -> Sent[Boxes]:
            boxes = self._seen[node.number][at]
            content = quantised_boxes(boxes.only(moving_of(boxes)), covariance=False)
            return sent(content, self._mtu, self._local(node, at), node.looks[at].clock_s)

        return self._kept(("moving", node.number, at), make)

    def _encoded(self, node: Node, at: int, *, along_site: bool) -> Encoded:
        def make() -> Encoded:
            pose = node.looks[at].reported
            return encoded(self._model, self._frame(node, at), pose, along_site=along_site)

        return self._kept(("encoded", node.number, at, along_site), make)

    def _frame(self, node: Node, at: int) -> Frame:
        return self._kept(("frame", node.number, at), lambda: node.frame(at))

    def _local(self, node: Node, at: int) -> Pose:
        return local_pose(self._frame(node, at), node.looks[at])[1]

    def _of_model(self, found: Found) -> Boxes:
        """Return a model's detections, with class numbers of ``DETECTED_CLASSES``."""
        names = self._model.design.classes
        number = np.array([DETECTED_CLASSES.index(one) for one in names], np.int64)
        return standing_boxes(found.box, number[found.number], found.score)

    def _kept(self, key: tuple[object, ...], make: Callable[[], _Made]) -> _Made:
        """Return the cached value of a key at this moment, or compute it."""
        if key not in self._made:
            self._made[key] = make()
        kept: _Made = self._made[key]
        return kept
