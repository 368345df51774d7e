"""`--demo`: a building of our own, and a simulated drive through it to run on."""

import argparse
from pathlib import Path

from data.common.errors import UserError
from data.generation.demo_building import DEMO_STOREYS, write_demo_building
from data.plans.bim import load_bim
from data.simulation.simulate import simulate
from sgslam.anchoring.storey_hypotheses import check_storey


def make_demo(options: argparse.Namespace, out: Path) -> None:
    """Writes the demo building and a simulated drive into the out folder, and points the options at them.

    Raises UserError for options that do not go with it, and where there is a demo already.
    """
    options.out, options.bim, drive = out, out / "demo_building.ifc", out / "demo_drive"
    if drive.exists():
        raise UserError(f"{out}: holds a demo already; give another --out")
    print(f"demo: writing a building of two storeys, {options.bim}")
    write_demo_building(options.bim)
    check_storey(load_bim(options.bim).graph, options.storey)  # a wrong name is told before the drive
    names = " and ".join(f"'{name}'" for name in DEMO_STOREYS)
    print(f"demo: driving through its {names} with a simulated LiDAR, {drive}")
    simulate(options.bim, DEMO_STOREYS, drive, seed=options.seed, min_rooms=4, min_length=30.0)
    options.scan_dir, options.ground_truth = drive / "scans", drive / "truth.tum"
    print("demo: now the main job, with nothing known but scans and building")
