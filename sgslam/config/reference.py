"""Every setting as a page of the documentation: tables made of the configuration itself."""

import re
from typing import TYPE_CHECKING, Any, get_args, get_origin

from sgslam.config.fields import choices_and_bounds, plain_yaml

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

HEADING = """# Parameters

<!-- Made by `sgslam dump-config --markdown --out docs/parameters.md`: do not edit. -->

All settings of a run with their defaults. `--set odometry.voxel_size=0.5` changes one, `--config FILE` takes many from
a YAML file, `sgslam dump-config` writes such a file, and every run leaves what was in force in its `config.yaml`. A
name or a value that is wrong is refused before anything runs. Lengths are in metres, angles in radians.
"""
_UNIT = re.compile(r"(m2|m/s|rad/s|m and rad|m or rad|m|rad)(?=$|[,; ])[,;]? ?")


def parameters_page(settings: "BaseModel") -> str:
    """Markdown: a section and a table for each group of settings, values as in `settings`."""
    parts = [HEADING]
    for name in type(settings).model_fields:
        group: BaseModel = getattr(settings, name)
        about = " ".join((type(group).__doc__ or "").split())
        rows = [_row(group, field, info) for field, info in type(group).model_fields.items()]
        head = ["| setting | type | default | unit | allowed | what |", "|---|---|---|---|---|---|"]
        parts.append("\n".join([f"## {name}", "", about, "", *head, *rows, ""]))
    return "\n".join(parts)


def _row(group: "BaseModel", name: str, info: "FieldInfo") -> str:
    """The unit is what a description begins with."""
    about = info.description or ""
    unit = _UNIT.match(about)
    meaning = about[unit.end() :] if unit else about
    default, allowed = f"`{plain_yaml(getattr(group, name))}`", "; ".join(choices_and_bounds(info))
    cells = [f"`{name}`", _kind(info.annotation), default, unit[1] if unit else "", allowed, meaning]
    return f"| {' | '.join(cells)} |"


def _kind(annotation: Any) -> str:
    words = {bool: "yes or no", int: "whole number", float: "number", str: "text"}
    if get_origin(annotation) is tuple:
        inner = get_args(annotation)
        return "numbers" if inner[-1] is Ellipsis else f"{len(inner)} numbers"
    return words.get(annotation, "word")
