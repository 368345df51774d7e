"""A page of results (BENCHMARKS.md) whose sections the commands that measure write themselves."""

import os
import platform
import re
from datetime import date
from pathlib import Path

from data.common.errors import UserError
from data.common.files import write_atomically

NAME = re.compile(r"[a-z0-9-]+")


def write_section(path: Path, name: str, markdown: str) -> None:
    """Replaces what stands between `<!-- name -->` and `<!-- /name -->` in the page, or adds the section at its end.

    Everything else on the page stays as it is. The page is written whole or not at all; it is made where it is missing.

    Raises UserError for a name that is no marker (lower-case letters, digits, hyphens), for a text that holds the
    markers itself, and for a page that holds one of the two markers only, or one of them twice.
    """
    if not NAME.fullmatch(name):
        raise UserError(f"'{name}' is no name of a section: lower-case letters, digits and hyphens only")
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    if begin in markdown or end in markdown:
        raise UserError(f"the text for section '{name}' holds the marker of the section")
    page = path.read_text() if path.exists() else ""
    section = f"{begin}\n{markdown.strip()}\n{end}"
    counts = (page.count(begin), page.count(end))
    if counts == (0, 0):
        page = f"{page.rstrip()}\n\n{section}\n".lstrip()
    elif counts == (1, 1) and page.index(begin) < page.index(end):
        page = page[: page.index(begin)] + section + page[page.index(end) + len(end) :]
    else:
        raise UserError(f"{path}: needs one '{begin}' and after it one '{end}', or neither of them")
    write_atomically(path, page)


def made_by(command: str) -> str:
    """One line for under a table: the command that made it, the machine and the date."""
    return f"`{command}` on {machine()}, {date.today().isoformat()}"


def machine() -> str:
    """The processor and how many cores of it there are."""
    return f"{_processor()}, {os.cpu_count()} cores"


def wall_clock() -> str:
    """What seconds are worth: how busy the machine has been lately."""
    return f"Seconds of the wall clock, on a machine whose load has been {os.getloadavg()[2]:.1f} for 15 minutes."


def _processor() -> str:
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        found = None
    return found.group(1).strip() if found else platform.processor() or platform.machine()
