"""What other SLAM systems leave behind, read as scans with poses."""

from data.slam_output.opening import open_slam_output

__all__ = ["open_slam_output"]
