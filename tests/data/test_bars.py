"""Bars of long stages: on a terminal, and nowhere else."""

import pytest

from data.common.bars import bars, steps


@pytest.mark.parametrize("is_terminal", [True, False])
def test_a_stage_has_a_bar_on_a_terminal_alone(
    is_terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("TTY_COMPATIBLE", "1" if is_terminal else "0")
    with bars():
        for item in steps(["a", "b", "c"], "second pass"):
            if item == "b":
                break
        assert list(steps(range(3), "adjustment")) == [0, 1, 2]
    assert list(steps(range(2), "of the library")) == [0, 1]
    printed = capsys.readouterr()
    assert printed.out == "" and ("adjustment" in printed.err) == is_terminal
    assert "of the library" not in printed.err and (is_terminal or printed.err == "")
