"""Artefacts: folders on disk that appear whole or not at all, and the documents in them."""

from urbantwin.artefact.checksum import sha256_of
from urbantwin.artefact.document import read_json, write_json
from urbantwin.artefact.folder import replaced_folder

__all__ = ["read_json", "replaced_folder", "sha256_of", "write_json"]
