"""The eight runs: the drives that they need, made once by the reference's code, and their commands."""

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from .folders import settled

DEMO = "demo_building.ifc"
INSTITUTE = Path("ifc/AC11-Institute-Var-2-IFC.ifc")
E1R, VLP16 = Path("scans/e1r_office"), Path("scans/vlp16_room_corridor")  # of the public data
INDOORS = ("--storey", "Ground floor")
DRIVES = {  # options of `sgslam simulate`, in the demo's building unless they name another
    "institute": ("--storey", "Erdgeschoss", "--seconds", "36"),
    "effects": (*INDOORS, "--carrier", "handheld", "--effects", "all", "--seconds", "36"),
    "imu": (*INDOORS, "--carrier", "handheld", "--effects", "rolling", "--imu", "mid360", "--seconds", "24"),
    "wheeled": (*INDOORS, "--seconds", "24"),
}
NEEDS = {"institute": "institute", "effects": "effects", "imu": "imu", "live": "wheeled", "resumed": "wheeled",
         "e1r": "e1r"}  # which drive a run needs  # fmt: skip
PUBLIC = {"institute": INSTITUTE, "e1r": E1R, "vlp16": VLP16}  # which public data
RUNS = ("vlp16", "demo", "institute", "effects", "imu", "live", "resumed", "e1r")
STOPPED_AT = 120  # scans: the run `resumed` is interrupted while it adds this one
INTERRUPTED = f"""
import os, signal
from data.common.cli import run_command
from sgslam import SceneGraphSlam
from sgslam.run import main

add_scan, count = SceneGraphSlam.add_scan, 0

def counted(self, *args, **more):
    global count
    count += 1
    if count == {STOPPED_AT}:
        os.kill(os.getpid(), signal.SIGINT)
    return add_scan(self, *args, **more)

SceneGraphSlam.add_scan = counted
run_command(main)
"""


@dataclass(frozen=True)
class Place:
    """Where the runs find what they need: `python` runs Python with the measured code, with arguments and an expected
    exit code; `code`, its folder; `inputs`, the drives; `data`, the public data."""

    python: Callable[..., None]
    code: Path
    inputs: Path
    data: Path


def make_drive(name: str, place: Place) -> None:
    """Writes one of DRIVES, or the scans `e1r`, unless it is there."""
    out, part = place.inputs / name, place.inputs / f"{name}.part"
    if out.exists():
        return
    shutil.rmtree(part, ignore_errors=True)
    building = place.data / INSTITUTE if name == "institute" else place.inputs / DEMO
    if name == "e1r":
        place.python(place.data / E1R / "unpack.py", part)
    else:
        if not building.exists():
            place.python("-m", "data.generation.demo_building", "--out", building)
        place.python("-m", "sgslam", "simulate", "--bim", building, "--out", part, *DRIVES[name])
    part.rename(out)


def make_run(name: str, place: Place, out: Path) -> None:
    """Runs one of RUNS into the folder `out`, and makes its files comparable."""
    drive = place.inputs / NEEDS.get(name, name)
    scans, truth = ("--scan-dir", drive / "scans"), ("--ground-truth", drive / "truth.tum")
    building, into = ("--bim", place.inputs / DEMO), ("--out", out)
    run = ("-m", "sgslam.run")
    if name == "demo":
        place.python(*run, "--demo", *into)
    elif name == "institute":
        place.python(*run, *scans, "--bim", place.data / INSTITUTE, *truth, *into)
    elif name == "effects":
        place.python(*run, *scans, *building, *truth, *into)
    elif name == "imu":
        place.python(*run, *scans, *building, *truth, *into, "--imu", drive / "scans" / "imu.csv")
    elif name == "live":
        place.python("-m", "sgslam", "live", drive / "scans", *building, *truth, *into, "--idle", "10")
    elif name == "resumed":
        place.python("-c", INTERRUPTED, *scans, *building, *truth, *into, code=2)
        place.python(*run, "--resume", out)
    elif name == "e1r":
        plan = place.data / E1R
        place.python(
            *run, "--scan-dir", drive, "--bim", plan / "plan.geojson", "--ground-truth", plan / "truth.tum", *into
        )
    else:
        place.python(*run, "--scan-dir", place.data / VLP16, *into)
    names = {out: "OUT", place.inputs: "INPUTS", place.data: "DATA", place.code: "CODE"}
    settled(out, names, lambda path: path.parent.name == "scans")


def last_words(done: subprocess.CompletedProcess[str]) -> str:
    """The last line that a process wrote to standard error."""
    return (done.stderr.strip().splitlines() or ["no output"])[-1]
