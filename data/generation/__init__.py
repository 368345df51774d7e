"""Buildings that are made: random ones, and the demo's, two storeys of our own design.

The demo's building has what a real model has and a robot meets: windows over parapets, doors, a stair, and furniture of
which the A-graph knows nothing; tall cupboards stand at walls and look like walls.
"""

from pathlib import Path

from data.common.files import write_atomically

DEMO_FILE = Path(__file__).with_name("demo_building.ifc")
DEMO_STOREYS = ("Ground floor", "Upper floor")  # in the order of the demo's drive, by the stair
DEMO_STOREY = DEMO_STOREYS[0]  # the one to drive, where it is to be one


def write_demo_building(path: Path | str) -> None:
    """Writes the IFC model of the demo's building."""
    write_atomically(path, DEMO_FILE.read_bytes())
