"""What the fields of the configuration may hold, in words and as YAML."""

from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo

BOUNDS = {"gt": "above {}", "ge": "{} or more", "lt": "below {}", "le": "{} or less"}


def choices_and_bounds(field: "FieldInfo") -> list[str]:
    """What a value may be, in words: its limits, and the words it is one of."""
    allowed = [text.format(getattr(m, key)) for m in field.metadata for key, text in BOUNDS.items() if hasattr(m, key)]
    choices = [str(choice) for choice in get_args(field.annotation) if isinstance(choice, str)]
    return [text for text in (", ".join(allowed), f"one of {', '.join(choices)}" if choices else "") if text]


def plain_yaml(value: Any) -> str:
    """A value as YAML has it, on one line."""
    import yaml

    plain = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=float("inf"))
    return text.removesuffix("...\n").strip()
