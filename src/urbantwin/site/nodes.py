"""Nodes that record together: rigs, clocks, poses and radio."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, field_validator, model_validator

from urbantwin.geometry import SiteFrame
from urbantwin.site.conditions import Angle, Strict
from urbantwin.site.rig import RideSpec, RigSpec, load_rig_spec, rig_spec_from
from urbantwin.site.yaml_document import Document, read_document, wrong

__all__ = [
    "MOST_NODES",
    "ClockSpec",
    "NodeSpec",
    "NodesFile",
    "PoseErrorSpec",
    "PoseOffset",
    "PoseSpread",
    "RadioSpec",
    "load_nodes",
]

#: Largest number of nodes.
MOST_NODES = 100
#: Largest clock offset and drift of a sensor, see `SensorSpec`.
_MOST_AHEAD_S, _MOST_DRIFT_PPM = 3600.0, 10000.0

_Metres = Annotated[float, Field(ge=-100.0, le=100.0, allow_inf_nan=False)]
_Spread = Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)]
_Moment = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class ClockSpec(Strict):
    """Clock of a node and all its sensors.

    Attributes:
        offset_s: offset ahead of true time at the motion's start, seconds.
        drift_ppm: excess rate, ppm.
    """

    offset_s: Annotated[float, Field(ge=-3600.0, le=3600.0, allow_inf_nan=False)] = 0.0
    drift_ppm: Annotated[float, Field(ge=-10000.0, le=10000.0, allow_inf_nan=False)] = 0.0


class PoseOffset(Strict):
    """Error of a pose along and about the axes of the node, metres and degrees."""

    forward_m: _Metres = 0.0
    left_m: _Metres = 0.0
    up_m: _Metres = 0.0
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    roll_deg: Angle = 0.0


class PoseSpread(Strict):
    """Standard deviations of a pose along and about the axes of the node, metres and degrees."""

    forward_m: _Spread = 0.0
    left_m: _Spread = 0.0
    up_m: _Spread = 0.0
    yaw_deg: _Spread = 0.0
    pitch_deg: _Spread = 0.0
    roll_deg: _Spread = 0.0


class PoseErrorSpec(Strict):
    """Error of a node's reported pose: the sum of four parts.

    Attributes:
        bias: constant error.
        drift: growth of the error per second from the motion's start.
        noise: independent error of every frame.
        walk: random walk from the motion's start: standard deviation after one second, growing with
            the square root of time.
    """

    bias: PoseOffset = PoseOffset()
    drift: PoseOffset = PoseOffset()
    noise: PoseSpread = PoseSpread()
    walk: PoseSpread = PoseSpread()


class SilenceSpec(Strict):
    """A period in which no frame of a node arrives.

    Attributes:
        start_s: start, time of the motion, seconds.
        stop_s: end, exclusive, seconds; ``None`` for no end.
    """

    start_s: _Moment = 0.0
    stop_s: _Moment | None = None

    @model_validator(mode="after")
    def _ends_later(self) -> SilenceSpec:
        if self.stop_s is not None and self.stop_s <= self.start_s:
            raise wrong(f"stops at {self.stop_s:g} s", f"later than its start, {self.start_s:g} s")
        return self


class RadioSpec(Strict):
    """Transmission of a node's frames to the others.

    Attributes:
        latency_s: mean delay from a complete frame to its arrival, seconds.
        jitter_s: standard deviation of the delay, which is never negative, seconds.
        loss: fraction of lost frames.
        outages: periods without arrivals, as of a failing node.
    """

    latency_s: Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)] = 0.0
    jitter_s: Annotated[float, Field(ge=0.0, le=10.0, allow_inf_nan=False)] = 0.0
    loss: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] = 0.0
    outages: list[SilenceSpec] = Field(default_factory=list)


def _ride_of(value: Any) -> Any:  # noqa: ANN401
    """Return a carrier as a mapping: a number is a track, a word a class."""
    if isinstance(value, int) and not isinstance(value, bool):
        return {"track": value}
    return {"class": value} if isinstance(value, str) else value


class NodeSpec(Strict):
    """A node: carrier, rig, clock, and errors of time and pose.

    Attributes:
        name: unique name; also that of its dataset's folder.
        rig: a rig's file, beside this one, or the rig itself; ``None`` for the twin's.
        ride: carrier, instead of the rig's; a track or a class.
        seed: random seed of its sensors; ``None`` to derive it from the run's seed and the name.
        clock: its clock.
        pose_error: error of its reported pose.
        radio: transmission of its frames.
    """

    name: Annotated[str, Field(description="a name, unique among the nodes")]
    rig: str | dict[str, Any] | None = None
    ride: Annotated[RideSpec | None, BeforeValidator(_ride_of)] = None
    seed: Annotated[int, Field(ge=0)] | None = None
    clock: ClockSpec = ClockSpec()
    pose_error: PoseErrorSpec = PoseErrorSpec()
    radio: RadioSpec = RadioSpec()

    @field_validator("name")
    @classmethod
    def _name_is_plain(cls, value: str) -> str:
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", value):
            raise wrong(f"{value!r:.40} cannot name a folder", "letters, digits, '_' and '-'")
        if value.lower() == "pictures":
            raise wrong("'pictures' is the folder of the pictures of all", "another name")
        return value


class _Nodes(Strict):
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0, allow_inf_nan=False)] | None = None
    nodes: Annotated[
        list[NodeSpec],
        Field(min_length=1, max_length=MOST_NODES, description="at least one node"),
    ]

    @field_validator("nodes")
    @classmethod
    def _names_are_unique(cls, value: list[NodeSpec]) -> list[NodeSpec]:
        seen: dict[str, str] = {}
        for one in value:  # some file systems ignore case
            other = seen.get(one.name.lower())
            if other is not None:
                said = f"{other!r} and {one.name!r}" if other != one.name else f"{one.name!r} twice"
                raise wrong(f"nodes are named {said}", "a different name for each")
            seen[one.name.lower()] = one.name
        return value


@dataclass(frozen=True)
class NodesFile:
    """Nodes of a file.

    Attributes:
        file: the file.
        nodes: the nodes, in the file's order.
        document: the file's document, for errors.
        rate_hz: frames per second of all nodes; ``None`` for the rigs' rates.
    """

    file: Path
    nodes: tuple[NodeSpec, ...]
    document: Document
    rate_hz: float | None = None

    def written(self) -> dict[str, Any]:
        """Return the nodes as stored in a file, defaults filled in."""
        rate = {} if self.rate_hz is None else {"rate_hz": self.rate_hz}
        nodes = [one.model_dump(exclude_none=True, by_alias=True) for one in self.nodes]
        return {**rate, "nodes": nodes}

    def rig_of(
        self, number: int, frame: SiteFrame | None, default: Path
    ) -> tuple[RigSpec, Path, str]:
        """Return the rig of a node, with its carrier, its clock and the nodes' rate.

        Args:
            number: index of the node.
            frame: the site's frame, for sensors placed by latitude and longitude.
            default: the rig's file for nodes that name none.

        Returns:
            The rig; its file; and the field that holds it, empty if the file is the rig.

        Raises:
            InputError: the rig's file is missing or wrong, a static rig has a carrier, or the rig
                has a dataset per sensor.
        """
        node, field = self.nodes[number], f"nodes[{number}].rig"
        at: tuple[int | str, ...] = ("nodes", number)
        if isinstance(node.rig, dict):
            spec, file = rig_spec_from(self.document.part(*at, "rig"), frame), self.file
        else:
            file = default if node.rig is None else self.file.parent / node.rig
            spec, field = load_rig_spec(file, frame), ""
        if node.ride is not None and spec.ride is None:
            raise self.document.error(
                "the rig is static", (*at, "ride"), "a rig with ride:, for a vehicle"
            )
        if not spec.fused:
            raise self.document.error(
                "has a dataset for each sensor (fused: false)",
                (*at, "rig"),
                "a rig whose sensors are fused; or a node for each sensor",
            )
        changed: dict[str, Any] = {"sensors": self._by_its_clock(spec, node, at)}
        if node.ride is not None:
            changed["ride"] = node.ride
        if self.rate_hz is not None:
            if spec.window_s is not None and spec.window_s * self.rate_hz > 1.0 + 1e-9:
                raise self.document.error(
                    f"is {self.rate_hz:g}, and the frames of {node.name} last {spec.window_s:g} s",
                    ("rate_hz",),
                    f"at most {1 / spec.window_s:g}",
                )
            changed["rate_hz"] = self.rate_hz
        return spec.model_copy(update=changed), file, field

    def _by_its_clock(self, spec: RigSpec, node: NodeSpec, at: tuple[int | str, ...]) -> list[Any]:
        """Return the sensors of a rig with the clock of its node applied."""
        sensors = []
        for one in spec.sensors:
            ahead_s = one.clock_offset_s + node.clock.offset_s
            drift_ppm = one.clock_drift_ppm + node.clock.drift_ppm
            if abs(ahead_s) > _MOST_AHEAD_S or abs(drift_ppm) > _MOST_DRIFT_PPM:
                raise self.document.error(
                    f"puts the clock of {one.name} {ahead_s:g} s and {drift_ppm:g} ppm ahead",
                    (*at, "clock"),
                    f"at most {_MOST_AHEAD_S:g} s and {_MOST_DRIFT_PPM:g} ppm",
                )
            clock = {"clock_offset_s": ahead_s, "clock_drift_ppm": drift_ppm}
            sensors.append(one.model_copy(update=clock))
        return sensors


def load_nodes(path: Path) -> NodesFile:
    """Read the nodes of a YAML file; their rigs are read when they are placed.

    Raises:
        InputError: the file is missing or wrong; names file, field and line.
    """
    document = read_document(path, kind="nodes")
    found = document.validated(_Nodes)
    return NodesFile(path, tuple(found.nodes), document, found.rate_hz)
