"""A ROS 2 node around `LiveSlam`: it translates messages, and nothing else. Untested: it was written without a ROS.

    source /opt/ros/jazzy/setup.bash && python examples/ros2_live.py --ros-args -r points:=/livox/lidar \\
        -p bim:=/path/to/BUILDING.ifc -p out:=/path/to/out

Takes `points` (sensor_msgs/PointCloud2) and `initialpose` (geometry_msgs/PoseWithCovarianceStamped). Sends the
transforms odom <- sensor and map <- odom to tf, in which `map` is the building once the map is anchored, `pose`
(geometry_msgs/PoseStamped) in the building, and `health` (std_msgs/String). Ctrl-C ends it; the results are in `out`.
"""

import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.cli import run_command
from data.common.errors import UnreadableScanError, UserError
from data.geometry.poses import poses_to_xyzquat
from data.scans.bags import POINT_CLOUD, read_cloud
from data.scans.scan import finished
from sgslam.live.live_slam import Answer, LiveSlam

try:
    import rclpy
    from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, TransformStamped
    from rclpy.node import Node
    from rclpy.qos import qos_profile_sensor_data
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import String
    from tf2_ros import TransformBroadcaster
except ImportError as error:  # told in one line by `main`
    Node, missing = object, str(error)
else:
    missing = ""

Floats = NDArray[np.float64]


class LiveNode(Node):  # type: ignore[misc]
    """Translates messages to calls of a LiveSlam, and its answers to messages."""

    def __init__(self) -> None:
        super().__init__("sgslam")
        bim, out = (self.declare_parameter(name, "").value for name in ("bim", "out"))
        if not out:
            raise UserError("the parameter 'out' is missing; give a folder for the results: -p out:=DIR")
        self.live = LiveSlam(Path(out), Path(bim) if bim else None)
        self._tf = TransformBroadcaster(self)
        self._pose = self.create_publisher(PoseStamped, "pose", 10)
        self._health = self.create_publisher(String, "health", 10)
        self.create_subscription(PointCloud2, "points", self._add, qos_profile_sensor_data)
        self.create_subscription(PoseWithCovarianceStamped, "initialpose", self._set_start, 1)

    def _add(self, message: Any) -> None:
        try:
            cloud = read_cloud(serialize_message(message), POINT_CLOUD, is_cdr=True)
            scan = finished(0, cloud.stamp_ns, cloud.points, cloud.times, Path())
            answer = self.live.add_scan(scan.stamp_ns, scan.points, scan.point_times)
        except (UnreadableScanError, UserError) as error:
            self.get_logger().warning(f"a scan is left out: {error}")
            return
        self._send(message.header, answer)

    def _send(self, header: Any, answer: Answer) -> None:
        T_map_odom = answer.T_map_odom if answer.T_bim_map is None else answer.T_bim_map @ answer.T_map_odom
        self._transform(header.stamp, "odom", header.frame_id, answer.T_odom_sensor)
        self._transform(header.stamp, "map", "odom", T_map_odom)
        self._health.publish(String(data=answer.health or "waiting"))
        if answer.T_bim_sensor is None:
            return
        pose = PoseStamped()
        pose.header.stamp, pose.header.frame_id = header.stamp, "map"
        place, turn = pose.pose.position, pose.pose.orientation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = _values(answer.T_bim_sensor)
        self._pose.publish(pose)

    def _transform(self, stamp: Any, parent: str, child: str, T_parent_child: Floats) -> None:
        sent = TransformStamped()
        sent.header.stamp, sent.header.frame_id, sent.child_frame_id = stamp, parent, child
        place, turn = sent.transform.translation, sent.transform.rotation
        place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w = _values(T_parent_child)
        self._tf.sendTransform(sent)

    def _set_start(self, message: Any) -> None:
        pose = message.pose.pose
        q = pose.orientation
        yaw = float(np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2)))
        self.live.set_start(pose.position.x, pose.position.y, yaw)


def _values(T: Floats) -> list[float]:
    """x, y, z, qx, qy, qz, qw of a pose (4, 4)."""
    return [float(value) for value in poses_to_xyzquat(T[None])[0]]


def main() -> None:
    """Raises UserError where there is no ROS, or the node's parameters are missing."""
    if missing:
        raise UserError(f"ROS 2 is not there ({missing}); source its setup file first")
    rclpy.init(args=sys.argv)
    node = LiveNode()
    try:
        with suppress(KeyboardInterrupt):  # Ctrl-C ends the node; the results are written all the same
            rclpy.spin(node)
    finally:
        node.live.finish()


if __name__ == "__main__":
    run_command(main)
