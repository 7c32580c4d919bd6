"""Pages, cards and other files from Jinja templates, with one style and escaped texts."""

from urbantwin.pages.render import card, page, text_file, write_page

__all__ = ["card", "page", "text_file", "write_page"]
