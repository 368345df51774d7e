"""The demo's building: `demo_building.ifc`, two storeys of our own design.

    python -m data.generation.demo_building --out FILE.ifc

It has what a real model has and a robot meets: windows over parapets, doors, a stair, and furniture of which
the A-graph knows nothing; tall cupboards stand at walls and look like walls.
"""

from pathlib import Path

from data.common.cli import Parser, run_command
from data.common.errors import UserError
from data.common.files import write_atomically

DEMO_FILE = Path(__file__).with_name("demo_building.ifc")
DEMO_STOREYS = ("Ground floor", "Upper floor")  # in the order of the demo's drive, by the stair
DEMO_STOREY = DEMO_STOREYS[0]  # the one to drive, where it is to be one


def write_demo_building(path: Path | str) -> None:
    """Writes the IFC model of the demo's building; raises UserError if `path` cannot be written."""
    path = Path(path)
    if path.suffix.lower() != ".ifc":
        raise UserError(f"{path}: not the name of an IFC file; give one that ends in .ifc")
    if not path.parent.is_dir():
        raise UserError(f"{path}: no such folder; create it first")
    write_atomically(path, DEMO_FILE.read_bytes())


def main(arguments: list[str] | None = None) -> int:
    """The command line; raises UserError."""
    about = "Write the demo's building as an IFC4 file."
    parser = Parser(prog="python -m data.generation.demo_building", description=about)
    parser.add_argument("--out", required=True, type=Path, metavar="FILE", help="file to write (.ifc)")
    path = parser.parse_args(arguments).out
    write_demo_building(path)
    print(f"{path}: two storeys; '{DEMO_STOREY}' is the one to drive")
    return 0


if __name__ == "__main__":
    run_command(main)
