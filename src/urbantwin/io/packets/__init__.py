"""Packets of spinning sensors, and packet captures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.io.packets.pcap import Datagram, datagrams_in, is_pcap, mapped, payload_of

__all__ = ["Datagram", "datagrams_in", "is_pcap", "mapped", "payload_of"]

names_on_demand(__name__)
