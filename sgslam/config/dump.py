"""All settings with their descriptions, as YAML for `--config`."""

import textwrap
from typing import TYPE_CHECKING

from sgslam.config.fields import choices_and_bounds, plain_yaml

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

WIDTH = 110


def documented_yaml(settings: "BaseModel", indent: str = "") -> str:
    """YAML of all settings, each with its description and allowed values in a comment above."""
    from pydantic import BaseModel

    lines = []
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if isinstance(value, BaseModel):
            lines += ["", *_comment(type(value).__doc__ or "", indent), f"{indent}{name}:"]
            lines.append(documented_yaml(value, indent + "  ").rstrip("\n"))
        else:
            lines += [*_comment(_meaning(field), indent), f"{indent}{name}: {plain_yaml(value)}"]
    return "\n".join(lines).lstrip("\n") + "\n"


def _meaning(field: "FieldInfo") -> str:
    return "; ".join(filter(None, [field.description, *choices_and_bounds(field)]))


def _comment(text: str, indent: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")
