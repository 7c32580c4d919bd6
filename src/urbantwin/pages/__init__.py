"""Pages and cards from Jinja templates: one base, one style, one policy, and texts escaped."""

from urbantwin.pages.render import card, page, write_page

__all__ = ["card", "page", "write_page"]
