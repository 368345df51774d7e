"""The jinja2 templates of the self-contained HTML pages; all text is escaped."""

import base64
import hashlib
from importlib.resources import files

from jinja2 import Environment, PackageLoader

from sgslam.report.elements import slug, tolerance_class
from sgslam.report.number_formats import metres, seconds, thousands


def _file(path: str) -> str:
    """The text of a style sheet or script, by its path in `sgslam`."""
    return files("sgslam").joinpath(path).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


TEMPLATES = Environment(loader=PackageLoader("sgslam", ""), autoescape=True, trim_blocks=True, lstrip_blocks=True)
TEMPLATES.globals["file"] = _file
TEMPLATES.filters |= {"digest": _digest, "thousands": thousands, "metres": metres, "seconds": seconds, "slug": slug}
TEMPLATES.filters["tolerance_class"] = tolerance_class
