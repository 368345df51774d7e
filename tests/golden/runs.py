"""The eight runs: the drives that they need, made once by the reference's code, and their commands."""

import shutil
import subprocess
from collections.abc import Callable
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
NEEDS = {name: name for name in ("institute", "effects", "imu", "e1r")}  # which drive a run needs
NEEDS |= {"live": "wheeled", "resumed": "wheeled"}
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


Python = Callable[..., None]  # runs Python with the measured code: its arguments, and `code`, the expected exit code


def make_drive(name: str, python: Python, inputs: Path, data: Path) -> None:
    """Writes one of DRIVES, or the scans `e1r`, to the folder of the inputs, unless it is there."""
    out, part, demo = inputs / name, inputs / f"{name}.part", inputs / DEMO
    if out.exists():
        return
    shutil.rmtree(part, ignore_errors=True)
    if name == "e1r":
        python(data / E1R / "unpack.py", part)
    else:
        if not demo.exists():
            code = "import shutil, data.generation as made; shutil.copy(made.__path__[0] + '/demo_building.ifc', {!r})"
            python("-c", code.format(str(demo)))
        building = data / INSTITUTE if name == "institute" else demo
        python("-m", "sgslam", "simulate", "--bim", building, "--out", part, *DRIVES[name])
    part.rename(out)


def make_run(name: str, python: Python, inputs: Path, data: Path, out: Path) -> None:
    """Runs one of RUNS into the folder `out`, and makes its files comparable."""
    drive, building = inputs / NEEDS.get(name, name), data / INSTITUTE if name == "institute" else inputs / DEMO
    run, into = ("-m", "sgslam.run"), ("--out", out)
    given = ("--bim", building, "--ground-truth", drive / "truth.tum", *into)
    scans = ("--scan-dir", drive / "scans")
    if name == "demo":
        python(*run, "--demo", *into)
    elif name == "vlp16":
        python(*run, "--scan-dir", data / VLP16, *into)
    elif name == "e1r":
        plan, truth = data / E1R / "plan.geojson", data / E1R / "truth.tum"
        python(*run, "--scan-dir", drive, "--bim", plan, "--ground-truth", truth, *into)
    elif name == "live":
        python("-m", "sgslam", "live", drive / "scans", *given, "--idle", "10")
    elif name == "resumed":
        python("-c", INTERRUPTED, *scans, *given, code=2)
        python(*run, "--resume", out)
    else:
        imu = ("--imu", drive / "scans" / "imu.csv") if name == "imu" else ()
        python(*run, *scans, *given, *imu)
    settled(out, {out: "OUT", inputs: "INPUTS", data: "DATA"}, lambda path: path.parent.name == "scans")


def last_words(done: subprocess.CompletedProcess[str]) -> str:
    """The last line that a process wrote to standard error."""
    return (done.stderr.strip().splitlines() or ["no output"])[-1]
