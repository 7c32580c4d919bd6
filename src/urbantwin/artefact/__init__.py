"""Artefacts: outputs that are written atomically, their inventories and documents."""

from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.disk_space import check_room
from urbantwin.artefact.document import as_json, read_json, write_json
from urbantwin.artefact.inventory import INVENTORY, Damage, damages, digest_of, write_inventory
from urbantwin.artefact.output import (
    KINDS,
    check_file,
    check_folder,
    kind_of,
    replaced_file,
    replaced_folder,
)
from urbantwin.artefact.scratch import claimed, new_folder, passing_folder, remove_dead
from urbantwin.artefact.verify import Verified, verify
from urbantwin.artefact.written_files import overwriting, publish_file

__all__ = [
    "INVENTORY",
    "KINDS",
    "Damage",
    "Verified",
    "as_json",
    "check_file",
    "check_folder",
    "check_room",
    "claimed",
    "damages",
    "digest_of",
    "kind_of",
    "new_folder",
    "overwriting",
    "passing_folder",
    "publish_file",
    "read_json",
    "remove_dead",
    "replaced_file",
    "replaced_folder",
    "sha256_of",
    "verify",
    "write_inventory",
    "write_json",
]
