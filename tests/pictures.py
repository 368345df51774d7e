"""Takes the pictures of the documentation, docs/pictures/*.png: `python -m tests.pictures`.

The browser's show the demo's run, or with `--out DIR` one that was made by `sgslam run --demo --out DIR`. The README's
shows a longer drive through the same building, by KISS-ICP alone and anchored (`--drift` makes it alone).
"""

import argparse
import io
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from evaluation.buildings import plan_graph
from evaluation.drive import DriveCase, drive_of
from evaluation.peers.odometries import kiss_icp_alone
from sgslam.cli.inspect_bim import main as inspect_bim
from sgslam.geometry.frames import inverse
from sgslam.run import main as run
from sgslam.slam import SceneGraphSlam
from sgslam.viewer.finished import FinishedRun, FinishedView, stored_truth
from sgslam.viewer.page import Page
from tests.helpers.chromium import Chromium

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SIZE = (1240, 800)
COLOURS = 256
LIFT_M = 3.0  # of the map over the plan, so that what is matched is seen
DRIFT = DriveCase(building="demo", seed=1, seconds=400.0)
DRAWN_S = 20.0  # without a GPU a picture takes its time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="a demo's folder, made already")
    parser.add_argument("--drift", action="store_true", help="the README's picture alone")
    options = parser.parse_args()
    out: Path | None = options.out
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        drift(scratch)
        if options.drift:
            return
        if out is None:
            out = scratch / "demo"
            run(["--demo", "--out", str(out)])
        inspect_bim([str(out / "demo_building.ifc"), "--out", str(scratch / "inspected")])
        view(out, scratch / "view")
        page(out / "report.html", "report", scratch / "report")
        page(scratch / "inspected" / "inspection.html", "inspector", scratch / "inspector")


def page(path: Path, name: str, profile: Path) -> None:
    """A page of ours, its beginning."""
    with Chromium(path, profile, SIZE) as browser:
        keep(browser.picture(), name)


def view(out: Path, profile: Path) -> None:
    """The ground floor of the plan, the map over it, half of the way driven."""
    opened = Page(("127.0.0.1", 0))
    shown = FinishedView(opened, [FinishedRun(out, stored_truth(out))])
    shown.panel.storey.value = next(iter(shown.scene.storeys.values()))
    shown.panel.lift.value = LIFT_M
    with Chromium(opened.url, profile, SIZE) as browser:
        browser.wait_for("document.body.innerText.includes('Anchored')")
        browser.evaluate("document.querySelector('.mantine-Notification-closeButton')?.click()")
        time.sleep(DRAWN_S)
        keep(browser.picture(), "view")
    opened.close()


def drift(scratch: Path) -> None:
    """The same scans located by KISS-ICP alone, its start given, and by us, nothing given; half a page high."""
    drive = drive_of(DRIFT, scratch)
    alone = kiss_icp_alone(drive.scans())
    alone = alone.transformed(drive.truth.poses[0] @ inverse(alone.poses[0]))
    plan = plan_graph(drive.plan)
    slam = SceneGraphSlam(bim=plan)
    for scan in drive.scans():
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
    result = slam.finish()
    figure = Figure(figsize=(12.4, 3.8), layout="constrained")
    for k, (title, path) in enumerate((("KISS-ICP alone", alone), ("anchored to the plan", result.trajectory))):
        off = np.linalg.norm(path.positions - drive.truth.at(path.stamps_ns)[:, :3, 3], axis=1)
        axes = figure.add_subplot(1, 2, k + 1)
        floor = min(plan.floors, key=lambda floor: floor.elevation or 0.0)
        for wall in plan.on_floor(floor.id).wall_surfaces:
            along = np.array([-wall.normal[1], wall.normal[0]]) * (wall.length or 0.0) / 2
            axes.plot(*np.stack([wall.centroid - along, wall.centroid + along], axis=1), color="#a3a9b2", lw=1.0)
        axes.plot(*drive.truth.positions[:, :2].T, color="#1c1f23", lw=0.8, ls=":", label="true way")
        axes.plot(*path.positions[:, :2].T, color=("#c2410c", "#6d28d9")[k], lw=1.2, label=title)
        rmse = float(np.sqrt(np.mean(off**2)))
        axes.set_title(f"{title}: RMSE {100 * rmse:.1f} cm, at most {100 * off.max():.0f} cm", fontsize=12)
        axes.set_aspect("equal")
        axes.axis("off")
        axes.legend(loc="lower center", ncols=2, frameon=False, bbox_to_anchor=(0.5, -0.08))
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    keep(buffer.getvalue(), "drift")


def keep(png: bytes, name: str) -> None:
    """Writes a picture with few colours: a quarter of the size."""
    image = Image.open(io.BytesIO(png)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(FOLDER / f"{name}.png", optimize=True)
    print(f"{FOLDER / name}.png: {(FOLDER / f'{name}.png').stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
