"""Search of files for data about people and machines: paths, names, e-mail addresses, times."""

from urbantwin.artefact.privacy.rules import names_here
from urbantwin.artefact.privacy.search import Finding, search_files

__all__ = ["Finding", "names_here", "search_files"]
