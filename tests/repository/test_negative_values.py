"""Values of options that begin with a minus sign, and angles that are none."""

from pathlib import Path

import pytest
from commands import refused

from data.common.cli import Parser


@pytest.mark.parametrize("given", [["--at", "-25,0,0"], ["--at=-25,0,0"], ["--at", "-.5,1,2"]])
def test_a_list_may_begin_with_a_negative_number(given: list[str]) -> None:
    parser = Parser(prog="p")
    parser.add_argument("--at")
    parser.add_argument("--flag", action="store_true")
    assert parser.parse_args([*given, "--flag"]).at.split(",")[0].startswith("-")
    assert parser.parse_args([*given, "--flag"]).flag


def test_angles_of_more_than_a_turn_are_refused(tmp_path: Path) -> None:
    for module, more in (("sgslam.run", ("--scan-dir", tmp_path)), ("data.simulate", ("--bim", "demo.ifc"))):
        said = refused(module, *more, "--out", tmp_path / "o", "--mount", "-400,0,0")
        assert "degrees" in said and "-400,0,0" in said
