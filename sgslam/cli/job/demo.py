"""`--demo`: generates a building and a simulated drive through it."""

import argparse
from pathlib import Path

from data.common.errors import UserError
from data.generation.demo_building import DEMO_STOREYS, write_demo_building
from data.scene_graph import Floor, SceneGraph
from data.simulation.simulate import simulate
from sgslam.anchoring import check_storey
from sgslam.warm_up import compile_ahead


def make_demo(options: argparse.Namespace, out: Path) -> None:
    """Writes the demo building and a simulated drive to the folder `out`, and sets the options to them.

    Raises UserError for an unknown storey and if the folder contains a demo already.
    """
    options.out, options.bim, drive = out, out / "demo_building.ifc", out / "demo_drive"
    if drive.exists():
        raise UserError(f"{out}: contains a demo already; give another --out")
    floors = tuple(Floor(name, name) for name in DEMO_STOREYS)
    check_storey(SceneGraph("bim", floors=floors), options.storey)  # before anything is written
    print(f"demo: writing a building with two storeys to {options.bim}")
    write_demo_building(options.bim)
    names = " and ".join(f"'{name}'" for name in DEMO_STOREYS)
    print(f"demo: simulating a LiDAR drive through {names} in {drive}")
    compile_ahead()  # meanwhile
    simulate(options.bim, DEMO_STOREYS, drive, seed=options.seed, min_rooms=4, min_length=30.0)
    options.scan_dir, options.ground_truth = drive / "scans", drive / "truth.tum"
    print("demo: running SLAM on the scans and the building")
