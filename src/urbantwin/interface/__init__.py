"""The functions that people call: one for every command, and what they return.

``urbantwin`` has all of them by their names (``import urbantwin as ut; ut.build(...)``); modules
here are imported when a name of theirs is first used, so that nobody waits for what they do not
call.
"""

__all__: list[str] = []
