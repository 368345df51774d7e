"""Runs SLAM scan by scan, as on a robot, and reads the pose, the graph and the anchors in between.

    python examples/scan_by_scan.py SCANS BUILDING.ifc

`python -m sgslam.run --demo --out demo` makes example data: demo/demo_drive/scans demo/demo_building.ifc.
"""

import sys

from data.common.cli import run_command
from data.common.errors import UserError
from data.scans import ScanFolder
from sgslam import SceneGraphSlam, load_bim


def main() -> None:
    """Raises UserError for unreadable input."""
    if len(sys.argv) != 3:
        raise UserError("usage: python examples/scan_by_scan.py SCANS BUILDING.ifc")
    scans, slam = ScanFolder(sys.argv[1]), SceneGraphSlam(bim=load_bim(sys.argv[2]))
    for scan in scans:  # or in your driver's callback: stamp in integer nanoseconds, points (N, 3) in metres
        update = slam.add_scan(scan.stamp_ns, scan.points)
        if scan.index % 50 and scan.index != len(scans) - 1:
            continue
        graph = slam.s_graph()
        line = f"scan {scan.index}: {update.keyframes} keyframes, {len(graph.rooms)} rooms"
        line += f", {len(graph.wall_surfaces)} wall surfaces"
        if slam.T_bim_map is not None:
            x, y, z = (slam.T_bim_map @ update.T_map_sensor)[:3, 3]
            tight = sum(anchor.state == "tight" for anchor in slam.anchors)
            line += f"; at {x:.2f} {y:.2f} {z:.2f} in the building, {tight} anchors"
        print(line)
    result = slam.finish()
    print("anchored" if result.anchored else "not anchored", result.reason, sep=": ")


if __name__ == "__main__":
    run_command(main)
