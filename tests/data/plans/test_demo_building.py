"""The command that writes the demo's building."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from data.common.errors import UserError
from data.generation.demo_building import DEMO_STOREY, write_demo_building


@pytest.mark.slow
def test_the_command_writes_the_same_bytes_whatever_the_path(tmp_path: Path) -> None:
    write_demo_building(ifc := tmp_path / "demo.ifc")
    command = [sys.executable, "-m", "data.generation.demo_building", "--out", "other.ifc"]
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert DEMO_STOREY in done.stdout and (tmp_path / "other.ifc").read_bytes() == ifc.read_bytes()
    for name in ("building.json", "no/such/folder.ifc"):
        with pytest.raises(UserError, match=name):
            write_demo_building(tmp_path / name)
