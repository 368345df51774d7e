"""Simulates a sensor carried through a building: an IFC file or a mesh in, scans and the truth out.

    python -m data.simulate --bim FILE --storey NAME --out DIR [--seed N] [--min-length M] [--moved-walls SHARE]
    python -m data.simulate --bim FILE --storey NAME --storey NEXT --out DIR
    python -m data.simulate --bim FILE --storey NAME --out DIR --carrier handheld --sensor Mid-360 --mount 180,0,0

DIR then holds `scans/000000.bin ...` (sensor frame), `scans/times.txt`, `truth.tum` (sensor poses in the BIM
frame), `run.json` (what was driven) and, if the building differs from its plan, `changes.json`,
`tolerances.json` if walls of an IFC model stand off their places (`--effects tolerance`), and `plan.ifc` if the plan is
to lack walls. `--imu` adds `scans/imu.csv`, in the sensor's axes. A robot's scan is a snapshot of one instant, without
motion distortion, unless `--effects rolling`; a person's is measured while the sensor moves, each point with its time.
"""

import argparse
from dataclasses import fields, replace

from data.common.cli import Parser, run_command
from data.plans.mesh_plan import MESH_SUFFIXES
from data.scans.writers import SCAN_WRITERS
from data.simulation import Changes
from data.simulation.carriers import CARRIERS, carrier_named
from data.simulation.changes import AS_PLANNED
from data.simulation.effects import ALL, EFFECTS
from data.simulation.sensor import IMUS, SENSORS, sensor_named
from data.simulation.simulate import IMU, simulate


def _parser() -> argparse.ArgumentParser:
    about = "Simulate a LiDAR carried through a building, and write its scans and ground truth."
    named = "".join(f"  {name:<10} {what}\n" for name, what in (*EFFECTS.items(), (ALL, "all of these")))
    effects = f"effects:\n{named}"
    formatter = argparse.RawDescriptionHelpFormatter
    parser = Parser("python -m data.simulate", description=about, epilog=effects, formatter_class=formatter)
    add = parser.add_argument

    def number(name: str, metavar: str, about: str, default: float | None = None, field: str | None = None) -> None:
        add(name, dest=field, type=type(default or 0.5), default=default, metavar=metavar, help=about)

    add("--bim", required=True, metavar="FILE", help=f"IFC file, or mesh ({', '.join(MESH_SUFFIXES)})")
    storeys = "name or GlobalId of the storey; required for an IFC file (mesh: name of a level, default the lowest); "
    storeys += "repeat the option to continue by the stairs to further storeys"
    add("--storey", action="append", default=[], metavar="NAME", help=storeys)
    add("--out", required=True, metavar="DIR", help="new or empty folder for scans and ground truth")
    add("--seed", type=int, default=0, help="random seed; the same seed gives the same bytes (default 0)")
    number("--min-rooms", "N", "number of rooms to enter (default 8, or all if fewer)", 8)
    number("--min-length", "M", "minimum length of drive in metres (default 120)", 120.0)
    for elements, shares in AS_PLANNED.shares.items():
        for kind in shares:
            field = kind if elements == "walls" else f"{elements}_{kind}"
            number(f"--{kind}-{elements}", "SHARE", f"share of {elements} that are {kind} (default 0)", 0.0, field)
    number("--moved-by", "M", "metres by which each wall is moved (default: 0.1 to 0.3 at random)")
    number("--displaced-by", "M", "metres by which openings and columns are displaced (default 0.1)", 0.1)
    number("--seconds", "S", "end the drive after this time in seconds")
    carriers = f"{', '.join(CARRIERS)}, or FILE.tum, a recorded motion to replay along the route (default wheeled)"
    add("--carrier", default="wheeled", metavar="NAME", help=carriers)
    number("--pace", "FACTOR", "speed factor of the recorded motion (default 1)", 1.0)
    add("--reversed", action="store_true", help="replay the recorded motion backwards")
    mount = "roll, pitch and yaw in degrees of the sensor on its carrier (default 0,0,0; upside down: 180,0,0)"
    add("--mount", type=_angles, default=(0.0, 0.0, 0.0), metavar="R,P,Y", help=mount)
    add("--sensor", default="VLP-16", metavar="NAME", help=f"{', '.join(SENSORS)} (default VLP-16)")
    number("--sensor-height", "M", "metres above the floor (default: the carrier's; wheeled 0.8)")
    add("--imu", metavar="NAME", help=f"simulate an IMU as well, in scans/imu.csv: {', '.join(IMUS)} (default none)")
    add("--effects", nargs="+", default=[], metavar="LIST", help="comma-separated names; see below")
    add("--format", choices=SCAN_WRITERS, help="format of the scans (default bin; ply for points with times)")
    return parser


def _angles(text: str) -> tuple[float, float, float]:
    try:
        angles = [float(part) for part in text.split(",")]
    except ValueError:
        angles = []
    if len(angles) != 3 or not all(abs(angle) <= 360.0 for angle in angles):
        about = "write roll,pitch,yaw in degrees, each from -360 to 360, e.g. 180,0,0"
        raise argparse.ArgumentTypeError(f"'{text}' is not three angles; {about}")
    roll, pitch, yaw = angles
    return roll, pitch, yaw


def main() -> int:
    """Runs the command. Raises UserError."""
    args = _parser().parse_args()
    carrier = carrier_named(args.carrier, args.pace, args.reversed)
    if args.sensor_height is not None:
        carrier = replace(carrier, height=args.sensor_height)
    run = simulate(
        args.bim,
        args.storey or "",
        args.out,
        args.seed,
        args.min_rooms,
        args.min_length,
        sensor_named(args.sensor),
        carrier,
        [name for names in args.effects for name in names.split(",") if name],
        Changes(**{field.name: getattr(args, field.name) for field in fields(Changes)}),
        mount_deg=args.mount,
        seconds=args.seconds,
        imu=args.imu,
        scan_format=args.format,
    )
    storeys = list(dict.fromkeys(run.storeys))
    reached = {storeys[0], *(room.storey for room in run.rooms)}
    names = ", ".join(f"'{name}'" for name in storeys if name in reached)
    driven = f"{run.length:.1f} m through {run.rooms_entered} room{'' if run.rooms_entered == 1 else 's'} of {names}"
    changed = f"; differences from the plan: {len(run.changes)}" if run.changes else ""
    print(f"{run.out_dir}: {len(run.truth)} scans, {driven}{changed}")
    if args.seconds is not None and (missed := [name for name in storeys if name not in reached]):
        print(f"not reached in {args.seconds:g} s: {', '.join(missed)}; increase --seconds or reduce --min-length")
    samples = f", {run.out_dir / 'scans' / IMU} to --imu" if args.imu else ""
    print(f"give {run.out_dir / 'scans'} to --scan-dir{samples}, and {run.out_dir / 'truth.tum'} to --ground-truth")
    return 0


if __name__ == "__main__":
    run_command(main)
