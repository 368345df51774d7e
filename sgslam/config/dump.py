"""`python -m sgslam.config.dump`: every setting in force with what it means, as YAML that `--config` reads back."""

import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

from data.common.cli import Parser, run_command

if TYPE_CHECKING:
    from pydantic import BaseModel
    from pydantic.fields import FieldInfo

WIDTH = 110
BOUNDS = {"gt": "above {}", "ge": "{} or more", "lt": "below {}", "le": "{} or less"}


def main(arguments: list[str] | None = None) -> int:
    """The command. Raises UserError for settings that are wrong."""
    parser = Parser(prog="python -m sgslam.config.dump", description="Every setting with what it means, as YAML.")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings as YAML, in place of the defaults")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="one setting; may be given again")
    parser.add_argument("--markdown", action="store_true", help="as a page of tables instead")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where it is written (default: standard output)")
    options = parser.parse_args(arguments)
    from data.common.files import write_atomically
    from sgslam.config.loading import load_config

    config = load_config(options.config, options.set)
    if options.markdown:
        from sgslam.config.reference import parameters_page

        text = parameters_page(config)
    else:
        text = explained(config)
    if options.out is None:
        print(text, end="")
    else:
        write_atomically(options.out, text)
    return 0


def explained(settings: "BaseModel", indent: str = "") -> str:
    """YAML of all settings; above each stands, as a comment, what it is, and which values it may have."""
    from pydantic import BaseModel

    lines = []
    for name, field in type(settings).model_fields.items():
        value = getattr(settings, name)
        if isinstance(value, BaseModel):
            lines += ["", *_comment(type(value).__doc__ or "", indent), f"{indent}{name}:"]
            lines.append(explained(value, indent + "  ").rstrip("\n"))
        else:
            lines += [*_comment(_meaning(field), indent), f"{indent}{name}: {plain_yaml(value)}"]
    return "\n".join(lines).lstrip("\n") + "\n"


def choices_and_bounds(field: "FieldInfo") -> list[str]:
    """What a value may be, in words: its limits, and the words it is one of."""
    allowed = [text.format(getattr(m, key)) for m in field.metadata for key, text in BOUNDS.items() if hasattr(m, key)]
    choices = [str(choice) for choice in get_args(field.annotation) if isinstance(choice, str)]
    return [text for text in (", ".join(allowed), f"one of {', '.join(choices)}" if choices else "") if text]


def _meaning(field: "FieldInfo") -> str:
    return "; ".join(filter(None, [field.description, *choices_and_bounds(field)]))


def _comment(text: str, indent: str) -> list[str]:
    return textwrap.wrap(" ".join(text.split()), WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def plain_yaml(value: Any) -> str:
    """A value as YAML has it, on one line."""
    import yaml

    plain = list(value) if isinstance(value, tuple) else value
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=float("inf"))
    return text.removesuffix("...\n").strip()


if __name__ == "__main__":
    run_command(main)
