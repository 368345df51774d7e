"""Simulates a robot that drives a building with a spinning LiDAR: an IFC file or a mesh in, scans and the truth out.

    python -m data.simulate --bim FILE --storey NAME --out DIR [--seed N] [--min-length M] [--moved-walls SHARE]
    python -m data.simulate --bim FILE --storey NAME --storey NEXT --out DIR

DIR then holds `scans/000000.bin ...` (sensor frame), `scans/times.txt`, `truth.tum` (sensor poses in the BIM
frame), `run.json` (what was driven) and, if the building differs from its plan, `changes.json`, and
`plan.ifc` if the plan is to lack walls. Each scan is a snapshot of one instant, without motion distortion,
unless `--rolling` asks for scans of a moving sensor, each point with its time.
"""

import argparse

from data.common.cli import Parser, run_command
from data.plans.mesh_files import MESH_SUFFIXES
from data.scans.writers import SCAN_WRITERS
from data.simulation import Changes, Robot
from data.simulation.simulate import ROBOT, simulate


def _parser() -> argparse.ArgumentParser:
    about = "Simulates a robot that drives a building with a spinning LiDAR: IFC in, scans and truth out."
    parser = Parser(prog="python -m data.simulate", description=about)
    add = parser.add_argument
    add("--bim", required=True, metavar="FILE", help=f"IFC file, or mesh ({', '.join(MESH_SUFFIXES)})")
    add("--storey", action="append", default=[], metavar="NAME",
        help="name or GlobalId of the storey to drive (a mesh needs none); again: the next, by the stairs")
    add("--out", required=True, metavar="DIR", help="new folder for scans and truth")
    add("--seed", type=int, default=0, help="same seed, same bytes (default 0)")
    add("--min-rooms", type=int, default=8, metavar="N", help="rooms to enter (default 8; all, where fewer)")
    add("--min-length", type=float, default=120.0, metavar="M", help="metres to drive at least (default 120)")
    add("--moved-walls", type=float, default=0.0, metavar="SHARE", help="of the walls, moved 10 to 30 cm (default 0)")
    add("--absent-walls", type=float, default=0.0, metavar="SHARE", help="of the walls, never built (default 0)")
    add("--unplanned-walls", type=float, default=0.0, metavar="SHARE", help="that stand and no plan shows (default 0)")
    add("--and-back", action="store_true", help="drive the whole way back again")
    add("--rolling", action="store_true", help="scans of a moving sensor, points with times (--format pcd or ply)")
    add("--speed", type=float, default=ROBOT.speed, help="metres a second (default 0.8)")
    add("--sensor-height", type=float, default=0.8, help="metres above the floor (default 0.8)")
    add("--format", default="bin", choices=SCAN_WRITERS, help="of the scans (default bin)")
    return parser


def main() -> int:
    """Runs the command. Raises UserError."""
    args = _parser().parse_args()
    run = simulate(
        args.bim, args.storey or "", args.out, args.seed, args.min_rooms, args.min_length,
        robot=Robot(speed=args.speed), sensor_height=args.sensor_height, scan_format=args.format,
        changes=Changes(args.moved_walls, args.absent_walls, args.unplanned_walls), and_back=args.and_back,
        rolling=args.rolling,
    )  # fmt: skip
    names = ", ".join(f"'{name}'" for name in dict.fromkeys(run.storeys))
    driven = f"{run.length:.1f} m, {run.rooms_entered} rooms of {names}"
    changed = f"; {len(run.changes)} walls stand otherwise than planned" if run.changes else ""
    print(f"{run.out_dir}: {len(run.truth)} scans, {driven}{changed}")
    return 0


if __name__ == "__main__":
    run_command(main)
