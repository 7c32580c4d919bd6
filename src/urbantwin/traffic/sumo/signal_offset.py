"""Networks with shifted offsets of their signal programs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from urbantwin.errors import InputError

__all__ = ["net_with_offsets"]


def net_with_offsets(net_path: Path, offsets: Mapping[str, float], out: Path) -> Path:
    """Write a SUMO network whose signal programs begin later, and return its path.

    Args:
        net_path: the network.
        offsets: delay of the cycle by program id, seconds.
        out: the file to write.

    Raises:
        InputError: there is no such program.
    """
    tree = etree.parse(net_path)
    programs = {logic.get("id", ""): logic for logic in tree.getroot().iterfind("tlLogic")}
    for name, seconds in offsets.items():
        if name not in programs:
            raise InputError(
                f"there is no signal program {name!r:.60}",
                place="signal",
                expected="one of " + ", ".join(programs) if programs else "a twin with signals",
            )
        usual = float(programs[name].get("offset", "0"))
        programs[name].set("offset", f"{usual + seconds:g}")
    tree.write(str(out), encoding="utf-8", xml_declaration=True)
    return out
