"""Loads and checks the configuration from a YAML file and `a.b=c` pairs; suggests the nearest name for unknown ones."""

import difflib
from pathlib import Path
from typing import Any, get_args, get_origin

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from data import UserError
from sgslam.config.documented import meaning
from sgslam.config.models import Config

_PLAIN = {  # in the words of a settings file, where pydantic speaks of Python
    "bool_parsing": "true or false is expected",
    "none_required": "null is expected",
}


def load_config(path: Path | None, pairs: list[str]) -> Config:
    """The defaults, overridden by a YAML file and then by pairs such as `odometry.voxel_size=0.4`.

    Raises UserError for a file that cannot be read, an unknown setting and an invalid value.
    """
    values: dict[str, Any] = {}
    if path is not None:
        values = _read(path)
        _check_names(values, Config, "", str(path))
    for pair in pairs:
        name, sign, text = pair.partition("=")
        if not sign:
            raise UserError(f"--set {pair}: not in the form a.b=c; write e.g. odometry.voxel_size=0.4")
        nested: Any = _yaml(text, f"--set {pair}")
        for part in reversed(name.strip().split(".")):
            nested = {part: nested}
        _check_names(nested, Config, "", f"--set {pair}")
        values = _merged(values, nested)
    try:
        return Config.model_validate(values)
    except ValidationError as error:
        raise UserError(_invalid(error)) from None


def _invalid(error: ValidationError) -> str:
    """One line on the first invalid setting: which, what is wrong, what was given, and what it means."""
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"][:2])  # without the place in a list
    what = _PLAIN.get(first["type"]) or first["msg"].replace("Input should be", "must be").partition(", unable")[0]
    shown = "" if first["type"] == "missing" else f" (given: {first['input']!r})"
    field = _field(where)
    if field is None:
        return f"setting {where}: {what}{shown}"
    if length := _length(field.annotation):
        example = "[" + ", ".join(["0"] * length) + "]"
        what = f"a list of {length} numbers is expected, e.g. {example}"
    about = f"; it is: {meaning(field)}" if field.description else ""
    return f"setting {where}: {what}{shown}{about}"


def _field(where: str) -> FieldInfo | None:
    """The field of a setting `group.name`; None for a group."""
    group, _, name = where.partition(".")
    settings = Config.model_fields[group].annotation if group in Config.model_fields else None
    fields: dict[str, FieldInfo] = getattr(settings, "model_fields", {})
    return fields.get(name)


def _length(annotation: Any) -> int:
    """How many values a tuple takes, also one that may be null; 0 for another type."""
    for kind in (annotation, *get_args(annotation)):
        if get_origin(kind) is tuple:
            return len(get_args(kind))
    return 0


def save_config(config: Config) -> str:
    """All settings as YAML, in the form that `load_config` reads."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)


def _read(path: Path) -> dict[str, Any]:
    try:
        text = path.read_text()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot read these settings ({type(error).__name__}); give a YAML file") from None
    values = _yaml(text, str(path))
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise UserError(f"{path}: not a table of settings; see config.yaml in a run's folder for the form")
    return values


def _yaml(text: str, where: str) -> Any:
    try:
        return yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # also huge numbers and endless nesting
        raise UserError(f"{where}: invalid YAML ({' '.join(str(error).split())})") from None


def _check_names(values: Any, model: type[BaseModel], prefix: str, where: str) -> None:
    if not isinstance(values, dict):
        raise UserError(f"{where}: '{prefix.rstrip('.')}' is a group of settings: {', '.join(model.model_fields)}")
    for name, value in values.items():
        if name not in model.model_fields:
            hint = _nearest(f"{prefix}{name}", isinstance(value, dict))
            raise UserError(f"{where}: unknown setting '{prefix}{name}'; {hint}")
        kind = model.model_fields[name].annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            _check_names(value, kind, f"{prefix}{name}.", where)


def _nearest(name: str, is_group: bool) -> str:
    """A hint with the nearest group for a table, or the nearest setting for a value."""
    groups = list(Config.model_fields)
    close_groups = difflib.get_close_matches(name, groups, 1, 0.5)
    if is_group:
        return f"did you mean '{close_groups[0]}'?" if close_groups else f"the groups are {', '.join(groups)}"
    names = [f"{group}.{key}" for group, values in Config().model_dump().items() for key in values]
    by_key = {known.split(".")[1]: known for known in names}
    close = difflib.get_close_matches(name, names, 1, 0.6)
    key = difflib.get_close_matches(name.split(".")[-1], list(by_key), 1, 0.0)
    return f"did you mean '{close[0] if close else by_key[key[0]]}'?"


def _merged(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    result = dict(old)
    for name, value in new.items():
        both = isinstance(value, dict) and isinstance(result.get(name), dict)
        result[name] = _merged(result[name], value) if both else value
    return result
