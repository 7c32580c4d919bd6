"""Public functions, one per command, and the classes that they return.

``urbantwin`` exports all of them (``import urbantwin as ut; ut.build(...)``); a module here is
imported when one of its names is first used, to keep imports fast.
"""

__all__: list[str] = []
