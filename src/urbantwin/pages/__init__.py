"""Pages: HTML from Jinja templates, with one base, one style and a content security policy."""

from urbantwin.pages.render import page, write_page

__all__ = ["page", "write_page"]
