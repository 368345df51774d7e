"""The templates of self-contained HTML pages, of this package and of `sgslam.inspection`; they escape all text."""

import base64
import hashlib
from importlib.resources import files

from jinja2 import Environment, PackageLoader

from sgslam.report.number_formats import metres, seconds, thousands


def _file(path: str) -> str:
    """A file of `sgslam`: a style or a script."""
    return files("sgslam").joinpath(path).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


TEMPLATES = Environment(loader=PackageLoader("sgslam", ""), autoescape=True, trim_blocks=True, lstrip_blocks=True)
TEMPLATES.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
TEMPLATES.globals["file"] = _file
TEMPLATES.filters |= {"digest": _digest, "thousands": thousands, "metres": metres, "seconds": seconds}
