"""The viewer: packets, a server on this machine, pages saved as a single file.

The page itself is TypeScript (``web/`` in a checkout); its bundle is in ``page/``.
"""

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.web.open_shown import open_shown
    from urbantwin.web.page_server import PageServer
    from urbantwin.web.rerun_file import write_rerun
    from urbantwin.web.saved_page import SavedPage, write_page
    from urbantwin.web.shown import Shown

__all__ = [
    "PageServer",
    "SavedPage",
    "Shown",
    "open_shown",
    "write_page",
    "write_rerun",
]

names_on_demand(__name__)
