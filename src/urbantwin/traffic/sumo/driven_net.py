"""The network that SUMO simulates: the twin's, adapted to a demand."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from urbantwin.traffic.demand.demand import Demand
from urbantwin.traffic.sumo.counted_signals import net_for_counts
from urbantwin.traffic.sumo.run_ups import net_with_run_ups
from urbantwin.traffic.sumo.signal_offset import net_with_offsets
from urbantwin.twin import Twin

__all__ = ["driven_net"]


def driven_net(
    twin: Twin, asked: Mapping[str, Any], demand: Demand, duration_s: float, scratch: Path
) -> Path:
    """Return SUMO's network: the twin's, or one with signals for counts, or with other offsets.

    Args:
        twin: the twin.
        asked: ``traffic`` of the site.
        demand: the trips.
        duration_s: duration of the motion, seconds.
        scratch: folder for networks that differ from the twin's.
    """
    net = twin.net_path
    if demand.counted:
        hours = (float(asked["warmup_s"]) + duration_s) / 3600
        net = net_for_counts(twin, demand, hours, scratch / "counted.net.xml")
        if not asked.get("scenario"):  # events have places on the twin's own lanes
            net = net_with_run_ups(net, demand, scratch / "longer.net.xml")
    if offsets := asked.get("signal_offsets"):
        net = net_with_offsets(net, offsets, scratch / "offset.net.xml")
    return net
