"""The pages of results say what the rows say."""

from pathlib import Path

import pytest

from evaluation.render import ROOT, Renderer, pages

RENDERER = Renderer()


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_page_says_what_the_rows_say(page: Path) -> None:
    text = page.read_text()
    assert RENDERER.page(text) == text, "written by hand, or rows changed: python -m evaluation render"
