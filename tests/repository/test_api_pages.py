"""The pages of docs/api say what the docstrings say, and leave no public name out."""

import importlib
import re

import pytest
from api_contents import LEFT_OUT, MORE, PAGES
from api_docstrings import first_sentence, markdown
from api_pages import FOLDER, pages
from api_source import Entry, entry

import data
import factors
import matching
import sgslam

COMMAND = "python tests/helpers/api_pages.py"
PATHS = [path for page in PAGES.values() for group in page.groups.values() for path in group.split()]

SAMPLE = '''"""Samples."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from sgslam.registration import Health

Floats = NDArray[np.float64]
Metres = Annotated[float, "m"]
State = Literal["on", "off"] | None
MOST = 7


@dataclass(frozen=True)
class Sample:
    """A sample. With more of it."""

    points: "Floats | None"
    state: State = None
    sizes: tuple[Metres, ...] = ()
    count: int = field(default=3, compare=False)

    @property
    def half(self) -> Metres:
        """Half of it."""
        return 0.5

    def move(self, other: "Sample", /, *, state_of_sample: dict[str, Health], most: int = MOST, **more: str) -> Floats:
        """Moves it."""

    def _inner(self) -> None: ...
'''


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Entry:
    folder = tmp_path_factory.mktemp("sources")
    (folder / "api_sample.py").write_text(SAMPLE)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        return entry("api_sample.Sample")


def test_the_pages_are_todays() -> None:
    assert {path.name: path.read_text() for path in FOLDER.glob("*.md")} == pages(), COMMAND


def test_every_public_name_has_an_entry() -> None:
    documented = {path.rpartition(".")[2] for path in PATHS}
    for package in (sgslam, data, matching, factors):
        assert set(package.__all__) <= documented, f"tests/helpers/api_contents.py, then {COMMAND}"


def test_every_entry_and_member_says_what_it_is() -> None:
    assert len(PATHS) == len({path.rpartition(".")[2] for path in PATHS}), "two entries with one heading"
    for own in map(entry, PATHS):
        assert first_sentence(own.text), own.path
        assert [member.name for member in own.members if not member.text] == [], own.path


def test_what_is_left_out_or_explained_is_there() -> None:
    things = {path.rpartition(".")[2]: path for path in PATHS}
    assert things.keys() >= MORE.keys()
    for name in LEFT_OUT:
        of, _, member = name.partition(".")
        module = importlib.import_module(things[of].rpartition(".")[0])
        assert hasattr(getattr(module, of), member), name


def test_links_lead_to_headings_that_are_there() -> None:
    docs = FOLDER.parent
    for page in FOLDER.glob("*.md"):
        for target, anchor in re.findall(r"\]\(([\w./]+\.md)#([\w-]+)\)", page.read_text()):
            headings = re.findall(r"^#+ (.+)$", (page.parent / target).read_text(), re.MULTILINE)
            slugs = {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}
            assert anchor in slugs, f"{page.relative_to(docs)}: {target}#{anchor}"


def test_a_class_is_declared_in_types_that_are_known_elsewhere(sample: Entry) -> None:
    assert sample.code == "\n".join([
        "from api_sample import Sample",
        "",
        "@dataclass(frozen=True)",
        "class Sample:",
        "    points: NDArray[np.float64] | None",
        "    state: Literal['on', 'off'] | None = None",
        "    sizes: tuple[float, ...] = ()",
        "    count: int = 3",
    ])  # fmt: skip
    half, move = sample.members
    assert half.is_property and (half.code, half.text) == ("float", "Half of it.")
    assert move.code == "\n".join([
        "def move(",
        "    self,",
        "    other: Sample,",
        "    /,",
        "    *,",
        "    state_of_sample: dict[str, Literal['good', 'degraded', 'lost']],",
        "    most: int = 7,",
        "    **more: str,",
        ") -> NDArray[np.float64]: ...",
    ])  # fmt: skip


def test_sections_of_a_docstring_become_lists() -> None:
    text = """Finds `it`. Or not.

Args:
    a, b: Two of `a`, with
        more.

Returns:
    The place: a tuple,
    or None.
It goes on.

Raises:
    ValueError: None is
        there."""
    assert markdown(text, {"it": "x.md#it", "a": "x.md#a"}).split("\n\n") == [
        "Finds [`it`](x.md#it). Or not.",
        "**Arguments**",
        "- `a`, `b`: Two of [`a`](x.md#a), with more.",
        "**Returns**: The place: a tuple, or None.",
        "It goes on.",
        "**Raises**",
        "- `ValueError`: None is there.",
    ]
    assert first_sentence("A map,\nin 3.5 parts. More.") == "A map, in 3.5 parts."
    assert first_sentence("No stop\n\nMore.") == "No stop"
