"""Files of messages by topic: bags of ROS 1 and ROS 2, and MCAP."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urbantwin.on_demand import names_on_demand

if TYPE_CHECKING:
    from urbantwin.io.bags.files import Message, MessageFile, Ros1Bag, SqliteBag, Topic
    from urbantwin.io.bags.mcap import McapFile

__all__ = ["McapFile", "Message", "MessageFile", "Ros1Bag", "SqliteBag", "Topic"]

names_on_demand(__name__)
