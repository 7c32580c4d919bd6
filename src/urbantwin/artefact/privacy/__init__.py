"""What files say of people and machines: paths, names, addresses of mail, times of day, places."""

from urbantwin.artefact.privacy.search import Finding, search_files
from urbantwin.artefact.privacy.this_machine import names_here

__all__ = ["Finding", "names_here", "search_files"]
