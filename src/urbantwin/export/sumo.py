"""The network as SUMO opens it."""

from __future__ import annotations

import shutil
from pathlib import Path

from lxml import etree

from urbantwin.artefact import replaced_folder, write_json
from urbantwin.twin import Twin

__all__ = ["write_sumo"]


def write_sumo(twin: Twin, folder: Path) -> None:
    """Write a folder with the network and a configuration that ``sumo`` and ``sumo-gui`` open.

    Raises:
        InputError: the folder holds something else.
    """
    with replaced_folder(folder, kind="sumo") as scratch:
        shutil.copyfile(twin.net_path, scratch / "network.net.xml")
        root = etree.Element("configuration")
        etree.SubElement(etree.SubElement(root, "input"), "net-file", value="network.net.xml")
        time = etree.SubElement(root, "time")
        etree.SubElement(time, "begin", value="0")
        etree.SubElement(time, "step-length", value=str(twin.site["traffic"]["step_s"]))
        etree.indent(root, space=" ")
        (scratch / "twin.sumocfg").write_bytes(
            bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8")) + b"\n"
        )
        write_json(
            scratch / "sumo.json",
            {"kind": "sumo", "twin": twin.manifest["name"], "twin_sha256": twin.sha256},
        )
