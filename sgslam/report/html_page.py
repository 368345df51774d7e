"""A self-contained page: styles and scripts of ours within it, and nothing else that the browser would run."""

import base64
import hashlib
import json
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any


def page(
    title: str, body: str, styles: Sequence[str], scripts: Sequence[str] = (), embedded: Mapping[str, Any] | None = None
) -> str:
    """The document. The browser itself refuses whatever is not in it, and any script or style but these.

    `styles` and `scripts` are files of this package; `embedded` are JSON values by the ids of their elements.
    """
    css = "".join(map(_read, styles))
    script = "\n" + "".join(map(_read, scripts))
    policy = f"default-src 'none'; style-src '{_digest(css)}'; script-src '{_digest(script)}'"
    blocks = "".join(
        f'<script type="application/json" id="{name}">{_json(value)}</script>\n'
        for name, value in (embedded or {}).items()
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{css}</style>\n</head>\n<body>\n<main>\n{body}\n</main>\n"
        f"{blocks}{f'<script>{script}</script>' if scripts else ''}\n</body>\n</html>\n"
    )


def _read(name: str) -> str:
    return files("sgslam.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _json(value: Any) -> str:
    """JSON that cannot end the script element that it stands in."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")
