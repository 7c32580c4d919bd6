"""Packets of Velodyne's and Hesai's sensors packed by their manuals, and captures of packets.

Nothing here is shared with the readers: each layout is written as its manual's table lists it.
"""

import struct
from pathlib import Path

import numpy as np

#: Where captures say that packets come from, and to which port they go.
SOURCE, PORT = (192, 168, 1, 201), 2368


def write_pcap(path, packets, *, order="<", fractions=10**6):
    """Write UDP packets: bytes, or (bytes, time, source, port)."""
    magic = {10**6: 0xA1B2C3D4, 10**9: 0xA1B23C4D}[fractions]
    data = [struct.pack(order + "IHHiIII", magic, 2, 4, 0, 0, 65535, 1)]
    for frame, time in framed(packets):
        parts = int(time), round((time - int(time)) * fractions), len(frame), len(frame)
        data += [struct.pack(order + "IIII", *parts), frame]
    Path(path).write_bytes(b"".join(data))


def write_pcapng(path, packets, *, order="<"):
    """Write UDP packets as Wireshark does: blocks of a section, an interface and packets."""

    def block(kind, body):
        body += bytes(-len(body) % 4)
        size = struct.pack(order + "I", len(body) + 12)
        return struct.pack(order + "I", kind) + size + body + size

    # The clock's steps are 10^-9 seconds: option 9 of one byte, then the end of options.
    options = struct.pack(order + "HHB3xHH", 9, 1, 9, 0, 0)
    data = block(0x0A0D0D0A, struct.pack(order + "IHHq", 0x1A2B3C4D, 1, 0, -1))
    data += block(1, struct.pack(order + "HHI", 1, 0, 65535) + options)
    for frame, time in framed(packets):
        steps = round(time * 1e9)
        head = struct.pack(order + "IIIII", 0, steps >> 32, steps & 0xFFFFFFFF, *[len(frame)] * 2)
        data += block(6, head + frame)
    Path(path).write_bytes(data)


def framed(packets):
    """Return the Ethernet frame and time of each packet (RFC 791, RFC 768)."""
    for number, one in enumerate(packets):
        payload, time, source, port = (
            one if isinstance(one, tuple) else (one, number * 1e-3, SOURCE, PORT)
        )
        udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), number & 0xFFFF, 0, 64, 17, 0,
                         bytes(source), bytes([255] * 4)) + udp  # fmt: skip
        yield bytes(12) + b"\x08\x00" + ip, time


#: The flags of a Velodyne's blocks, lowest lasers first, and the byte of each model.
BANKS = (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF)
VELODYNE = {
    "HDL-32E": 0x21,
    "VLP-16": 0x22,
    "VLP-16 Hi-Res": 0x24,
    "VLP-32C": 0x28,
    "VLS-128": 0xA1,
}
STRONGEST, LAST, DUAL = 0x37, 0x38, 0x39


def velodyne_packet(azimuths, lasers, model, *, mode=STRONGEST, stamp_us=0, banks=BANKS[:1]):
    """Return one packet: of each of twelve blocks an azimuth (deg) and 32 (steps, intensity)."""
    data = b""
    for number, (azimuth, block) in enumerate(zip(azimuths, lasers, strict=True)):
        data += struct.pack("<HH", banks[number % len(banks)], round(azimuth * 100) % 36000)
        for steps, intensity in block:
            data += struct.pack("<HB", steps, intensity)
    tail = struct.pack("<I", stamp_us) + (
        model if isinstance(model, bytes) else bytes([mode, model])
    )
    assert len(data + tail) == 1206
    return data + tail


def hesai_packet(
    model, azimuths, distance, intensity, *, mode=0x37, stamp_us=0, second=0, flags=None
):
    """Return one packet of a Hesai, by its manual's "Point Cloud Data Packet".

    Args:
        model: by its name in the catalogue.
        azimuths: (B,) of each block, degrees clockwise.
        distance: (B, C) steps of 4 mm.
        intensity: (B, C).
        mode: of returns.
        stamp_us: microseconds of the second.
        second: of the minute 2024-03-05 06:07 UTC.
        flags: of the header, where a model has them; sets which parts follow.
    """
    blocks, channels = distance.shape

    def body(beside, before=b""):
        data = b""
        for azimuth, row, other in zip(azimuths, distance, intensity, strict=True):
            data += before + struct.pack("<H", round(azimuth * 100) % 36000)
            for steps, value in zip(row, other, strict=True):
                data += struct.pack("<HB", steps, value) + beside
        return data

    from_1900, from_2000 = (bytes([year, 3, 5, 6, 7, second]) for year in (124, 24))
    stamp = struct.pack("<I", stamp_us)
    motor = struct.pack("<H", 600)
    if model in ("Pandar40P", "Pandar40M"):
        # Reserved 5, shutdown 1, reserved 2, motor 2, timestamp 4, mode 1, factory 1, date 6.
        return body(b"", b"\xff\xee") + bytes(8) + motor + stamp + bytes([mode, 0x42]) + from_2000
    if model == "Pandar64":
        # EE FF, lasers, blocks, reserved, unit (mm), reserved 2; the tail of a Pandar40P.
        head = b"\xee\xff" + bytes([64, 6, 0, 4, 0, 0])
        return head + body(b"") + bytes(8) + motor + stamp + bytes([mode, 0x42]) + from_2000
    protocol = {
        "Pandar128": (1, 4),
        "Pandar90": (1, 4),
        "OT128": (1, 4),
        "QT128": (3, 2),
        "PandarQT": (3, 1),
    }
    major, minor = protocol.get(model, (6, 1))
    flags = {(1, 4): 0x05, (3, 2): 0x15}.get((major, minor), 1) if flags is None else flags
    # EE FF, protocol 2, reserved 2, lasers, blocks, first return, unit, returns, flags.
    head = b"\xee\xff" + bytes([major, minor, 0, 0, channels, blocks, 0, 4, 1, flags])
    sequence = struct.pack("<I", 7)
    if model == "PandarQT":
        # Reserved 10, motor 2, timestamp 4, mode 1, factory 1, date 6, sequence 4.
        tail = bytes(10) + motor + stamp + bytes([mode, 0x42]) + from_1900 + sequence
        return head + body(b"\x09") + tail
    if (major, minor) == (6, 1):
        # Reserved 10, mode 1, motor 2, date 6, timestamp 4, factory 1, sequence 4.
        return (
            head
            + body(b"\x09")
            + bytes(10)
            + bytes([mode])
            + motor
            + from_1900
            + stamp
            + b"\x42"
            + sequence
        )
    # A checksum; functional safety 17; reserved 12 (of which the state of the azimuth and of the
    # operation), mode 1, motor 2, date 6, timestamp 4, factory 1; sequence 4; IMU 22; checksum 4;
    # signature 32.
    beside = b"\x09" * (bool(flags & 0x10) + bool(flags & 0x20))
    state = 2 if model == "Pandar128" else 1  # standard
    reserved = bytes(9) + bytes(2) + bytes([state]) if (major, minor) == (1, 4) else bytes(12)
    return (
        head + body(beside) + b"CRC1" + bytes(17) * bool(flags & 4)
        + reserved + bytes([mode]) + motor + from_1900 + stamp + b"\x42"
        + sequence * (flags & 1) + bytes(22) * bool(flags & 2) + b"CRC2"
        + bytes(32) * bool(flags & 8)
    )  # fmt: skip


def hesai_turns(
    model, channels, blocks, *, columns=360, turns=2.2, start=180.0, seed=1, returns=1, **known
):
    """Return packets of a turning sensor, and azimuth, steps and intensity of every firing.

    Of several returns the first of each firing is returned, and the others lie a metre beyond.
    """
    rng = np.random.default_rng(seed)
    firings = round(turns * columns / blocks * returns) * blocks // returns
    azimuth = (start + np.arange(firings) * 360 / columns) % 360
    steps = rng.integers(250, 20000, (firings, channels))
    steps[rng.random(steps.shape) < 0.2] = 0
    intensity = rng.integers(0, 256, steps.shape)
    every = np.repeat(np.arange(firings), returns)
    later = np.tile(np.arange(returns), firings)[:, None] * 250
    packets = []
    for at in range(0, len(every), blocks):
        some = every[at : at + blocks]
        distance = np.where(steps[some] > 0, steps[some] + later[at : at + blocks], 0)
        # Ten turns a second.
        sent_us = round(some[-1] / columns * 1e5)
        packets.append(
            hesai_packet(model, azimuth[some], distance, intensity[some], second=sent_us // 10**6,
                         stamp_us=sent_us % 10**6, **known)
        )  # fmt: skip
    return packets, azimuth, steps, intensity
