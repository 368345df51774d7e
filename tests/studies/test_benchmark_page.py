"""The page of results: a section is replaced, the rest of the page stays."""

import pytest

from data.common.errors import UserError
from evaluation.harness.benchmark_page import made_by, write_section


def test_a_section_is_replaced_and_the_rest_stays(tmp_path):
    page = tmp_path / "BENCHMARKS.md"
    page.write_text("# Results\n\n<!-- one -->\nold\n<!-- /one -->\n\nBy hand.\n\n<!-- two -->\ntwo\n<!-- /two -->\n")
    write_section(page, "one", "## One\n\n| a |\n")
    assert page.read_text() == (
        "# Results\n\n<!-- one -->\n## One\n\n| a |\n<!-- /one -->\n\nBy hand.\n\n<!-- two -->\ntwo\n<!-- /two -->\n"
    )
    before = page.read_text()
    write_section(page, "one", "## One\n\n| a |\n")
    assert page.read_text() == before


def test_a_new_section_goes_to_the_end_of_the_page_which_is_made_where_missing(tmp_path):
    page = tmp_path / "BENCHMARKS.md"
    write_section(page, "one", "first")
    write_section(page, "two", "second")
    assert page.read_text() == "<!-- one -->\nfirst\n<!-- /one -->\n\n<!-- two -->\nsecond\n<!-- /two -->\n"


@pytest.mark.parametrize(
    "text", ["<!-- one -->", "<!-- /one --> <!-- one -->", "<!-- one --><!-- one --><!-- /one -->"]
)
def test_a_page_with_broken_markers_is_refused_and_kept(tmp_path, text):
    page = tmp_path / "BENCHMARKS.md"
    page.write_text(text)
    with pytest.raises(UserError, match="<!-- one -->"):
        write_section(page, "one", "text")
    assert page.read_text() == text


def test_the_line_under_a_table_tells_command_machine_and_date():
    assert "`python -m x --y`" in made_by("python -m x --y") and "cores" in made_by("x")
