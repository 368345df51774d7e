"""The command that writes the demo's building."""

from pathlib import Path

import pytest

from data.common.errors import UserError
from data.generation.demo_building import DEMO_FILE, DEMO_STOREYS, main
from data.ifc.graph import read_ifc


def test_the_command_writes_the_building(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--out", str(ifc := tmp_path / "demo.ifc")]) == 0
    assert DEMO_STOREYS[0] in capsys.readouterr().out and ifc.read_bytes() == DEMO_FILE.read_bytes()
    assert tuple(floor.name for floor in read_ifc(ifc)[0].floors) == DEMO_STOREYS
    for name in ("building.json", "no/such/folder.ifc"):
        with pytest.raises(UserError, match=name):
            main(["--out", str(tmp_path / name)])
