"""The meaning, bounds and values of configuration fields as text."""

from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

BOUNDS = {"gt": "above {}", "ge": "{} or more", "lt": "below {}", "le": "{} or less"}


def choices_and_bounds(field: "FieldInfo") -> list[str]:
    """The bounds and the choices of a field, in words."""
    allowed = [text.format(getattr(m, key)) for m in field.metadata for key, text in BOUNDS.items() if hasattr(m, key)]
    choices = [str(choice) for choice in get_args(field.annotation) if isinstance(choice, str)]
    return [text for text in (", ".join(allowed), f"one of {', '.join(choices)}" if choices else "") if text]


def meaning(field: "FieldInfo") -> str:
    """What a field is, as one line; it begins with the unit."""
    return " ".join((field.description or "").split())


def plain_yaml(value: Any) -> str:
    """A value as one line of YAML."""
    import yaml

    plain = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=float("inf"))
    return text.removesuffix("...\n").strip()
