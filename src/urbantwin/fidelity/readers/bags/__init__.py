"""Bags of ROS 1 and ROS 2 and MCAP files: clouds, or packets of a LiDAR, on one of their topics."""

from urbantwin.fidelity.readers.bags.recording import is_mcap, is_rosbag, open_bag

__all__ = ["is_mcap", "is_rosbag", "open_bag"]
