"""What files say of people and machines: paths, names, addresses of mail, times of day, places."""

from urbantwin.artefact.privacy.rules import names_here
from urbantwin.artefact.privacy.search import Finding, search_files

__all__ = ["Finding", "names_here", "search_files"]
