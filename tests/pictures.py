"""`python -m tests.pictures`: takes the pictures of the documentation, docs/pictures/*.png, with the tests' browser.

They show the demo's run, or with `--out DIR` one that was made by `sgslam run --demo --out DIR`.
"""

import argparse
import io
import tempfile
import time
from pathlib import Path

from PIL import Image

from sgslam.cli.inspect_bim import main as inspect_bim
from sgslam.run import main as run
from sgslam.viewer.finished import FinishedRun, FinishedView, stored_truth
from sgslam.viewer.page import Page
from tests.helpers.chromium import Chromium

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SIZE = (1240, 800)
COLOURS = 256
LIFT_M = 3.0  # of the map over the plan, so that what is matched is seen
DRAWN_S = 20.0  # without a GPU a picture takes its time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, help="a demo's folder, made already")
    out: Path | None = parser.parse_args().out
    FOLDER.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
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


def keep(png: bytes, name: str) -> None:
    """Writes a picture with few colours: a quarter of the size."""
    image = Image.open(io.BytesIO(png)).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(FOLDER / f"{name}.png", optimize=True)
    print(f"{FOLDER / name}.png: {(FOLDER / f'{name}.png').stat().st_size // 1000} kB")


if __name__ == "__main__":
    main()
