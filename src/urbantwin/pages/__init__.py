"""Pages, cards and other files from Jinja templates: one base, one style, texts escaped."""

from urbantwin.pages.render import card, page, text_file, write_page

__all__ = ["card", "page", "text_file", "write_page"]
