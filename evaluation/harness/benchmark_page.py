"""The page of results (BENCHMARKS.md), whose sections are written by the measuring commands."""

import os
import platform
import re
from datetime import date
from pathlib import Path

from data.common.errors import UserError
from data.common.files import write_atomically

NAME = re.compile(r"[a-z0-9-]+")


def write_section(path: Path, name: str, markdown: str) -> None:
    """Replaces the text between `<!-- name -->` and `<!-- /name -->` in the page, or appends the section.

    The rest of the page does not change. The page is written atomically and created if it is missing. Raises UserError
    for an invalid name (allowed: lower-case letters, digits, hyphens), a text that contains the markers, and a page in
    which the two markers do not form one pair.
    """
    if not NAME.fullmatch(name):
        raise UserError(f"'{name}': invalid section name; use lower-case letters, digits and hyphens only")
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    if begin in markdown or end in markdown:
        raise UserError(f"the text for section '{name}' contains the section's marker; remove it")
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
    """The source of a table in one line: the command, the machine and the date."""
    return f"`{command}` on {machine()}, {date.today().isoformat()}"


def machine() -> str:
    """The processor and its number of cores."""
    return f"{_processor()}, {os.cpu_count()} cores"


def wall_clock() -> str:
    """A note on wall-clock times: the machine's load average."""
    return f"Wall-clock seconds on a machine with a load average (15 minutes) of {os.getloadavg()[2]:.1f}."


def _processor() -> str:
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        found = None
    return found.group(1).strip() if found else platform.processor() or platform.machine()
