"""Docstrings as Markdown: their sections become lists, names that have an entry become links."""

import re
from collections.abc import Mapping
from textwrap import dedent

_SECTION = re.compile(r"(Args|Attributes|Returns|Raises):")
_ITEM = re.compile(r"([\w*]+(?:, [\w*]+)*): (.*)")
_NAME = re.compile(r"`([A-Za-z_][\w.]*)`")
_TITLES = {"Args": "Arguments"}


def markdown(text: str, links: Mapping[str, str]) -> str:
    """A docstring; `links` are the targets of names that have an entry elsewhere."""
    parts: list[str] = []
    lines = text.splitlines()
    while lines:
        section = _SECTION.fullmatch(lines[0])
        if section is None:
            parts.append(linked(lines.pop(0), links))
            continue
        lines.pop(0)
        inner = []
        while lines and (not lines[0] or lines[0][0] == " "):
            inner.append(lines.pop(0))
        parts += ["", *_section(section[1], dedent("\n".join(inner)).strip(), links), ""]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(parts)).strip()


def first_sentence(text: str) -> str:
    """In one line."""
    paragraph = " ".join(text.partition("\n\n")[0].split())
    sentence = re.match(r".+?\.(?=\s|$)", paragraph)
    return sentence[0] if sentence else paragraph


def linked(text: str, links: Mapping[str, str]) -> str:
    """With the names in backticks as links, where they have an entry."""
    return _NAME.sub(lambda name: f"[{name[0]}]({links[name[1]]})" if name[1] in links else name[0], text)


def _section(kind: str, text: str, links: Mapping[str, str]) -> list[str]:
    title = f"**{_TITLES.get(kind, kind)}**"
    if kind == "Returns":
        return [f"{title}: {linked(' '.join(text.split()), links)}"]
    items: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        begins = _ITEM.fullmatch(line)
        if begins:
            items.append((", ".join(f"`{name}`" for name in begins[1].split(", ")), [begins[2]]))
        else:
            items[-1][1].append(line.strip())
    own = links if kind == "Raises" else {}  # an argument is no class of the same name
    return [title, "", *(f"- {linked(names, own)}: {linked(' '.join(told), links)}" for names, told in items)]
