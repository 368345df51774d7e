"""The pages of results say what the rows say."""

import re
from pathlib import Path

import pytest

from evaluation.render import BLOCK, ROOT, Renderer, pages


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer()


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_page_says_what_the_rows_say(page: Path, renderer: Renderer) -> None:
    text = page.read_text()
    assert renderer.page(text) == text, "written by hand, or rows changed: python -m evaluation render"


def test_a_number_changed_by_hand_is_found(renderer: Renderer) -> None:
    text = (ROOT / "README.md").read_text()
    block = next(BLOCK.finditer(text))
    changed = re.sub(r"\d(?=\D*$)", lambda digit: str((int(digit[0]) + 1) % 10), block[4])
    edited = text.replace(block[0], block[1] + changed + block[5])
    assert edited != text == renderer.page(edited)
