"""What NVIDIA Warp compiles for a device. Only `lidar.casting.warp` imports it, where it is needed.

Types are Warp's: arguments of kernels are arrays on the device.
"""

__all__: list[str] = []
