"""The demo's building is a file of the package."""

from pathlib import Path

from data.generation import DEMO_FILE, DEMO_STOREYS, write_demo_building
from data.ifc.graph import read_ifc


def test_the_building_is_written_and_has_its_storeys(tmp_path: Path) -> None:
    write_demo_building(ifc := tmp_path / "demo.ifc")
    assert ifc.read_bytes() == DEMO_FILE.read_bytes()
    assert tuple(floor.name for floor in read_ifc(ifc)[0].floors) == DEMO_STOREYS
