"""A public name as its source defines it: its signature in plain types, its docstring, its members."""

import ast
import importlib
import inspect
import sys
from collections.abc import Collection
from dataclasses import dataclass

from api_types import plain_type, tree

from data.common.build import PACKAGES

WIDTH = 100  # of a signature's line
_SPECIAL = ("__len__", "__iter__")
Definition = ast.FunctionDef | ast.ClassDef


@dataclass(frozen=True)
class Member:
    """A method, or a property, of which `code` is the type."""

    name: str
    code: str
    text: str
    is_property: bool


@dataclass(frozen=True)
class Entry:
    """A class or function. `path` is its public one; `code` imports and declares it; `members` are those of a class."""

    path: str
    code: str
    text: str
    members: tuple[Member, ...]

    @property
    def name(self) -> str:
        """Without the module."""
        return self.path.rpartition(".")[2]


def entry(path: str, left_out: Collection[str] = ()) -> Entry:
    """Reads a public name such as `sgslam.SceneGraphSlam`, without the members `left_out`, such as `Matcher.__init__`.

    Raises KeyError where our sources do not define it.
    """
    public, _, name = path.rpartition(".")
    home = getattr(importlib.import_module(public), name).__module__
    node = {n.name: n for n in tree(home).body if isinstance(n, Definition)}[name]  # the last: after its overloads
    begin = f"from {public} import {name}\n\n"
    if isinstance(node, ast.FunctionDef):
        return Entry(path, begin + _signature(node, home), _text(node), ())
    inner = {own.name: own for own in node.body if isinstance(own, ast.FunctionDef)}
    inner = {own: inner[own] for own in inner if f"{name}.{own}" not in left_out}
    members = tuple(_member(inner[own], home) for own in inner if own[0] != "_" or own in _SPECIAL)
    made, text = inner.get("__init__"), _text(node)
    for special in ("__init__", "__post_init__"):
        told = _text(inner[special]) if special in inner else ""
        if told and (special == "__init__" or "Raises" not in text):
            text += f"\n\n**Constructor**: {told}"
    return Entry(path, begin + _declaration(node, made, home), text, members)


def _text(node: Definition) -> str:
    return ast.get_docstring(node) or ""


def _member(node: ast.FunctionDef, module: str) -> Member:
    decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
    if {"property", "cached_property"} & set(decorators):
        return Member(node.name, plain_type(node.returns, module), _text(node), True)
    kept = "".join(f"@{name}\n" for name in decorators if name in ("staticmethod", "classmethod"))
    return Member(node.name, kept + _signature(node, module), _text(node), False)


def _declaration(node: ast.ClassDef, made: ast.FunctionDef | None, module: str) -> str:
    """A class with its fields and its constructor."""
    bases = [ast.unparse(base) for base in node.bases]
    bases = [base for base in bases if not _is_inner(base, module)]
    body = [_field(own, module) for own in node.body if isinstance(own, ast.AnnAssign)]
    if made is not None:
        body += [""] * bool(body) + _signature(made, module).splitlines()
    decorators = "".join(f"@{ast.unparse(decorator)}\n" for decorator in node.decorator_list)
    of = f"({', '.join(bases)})" if bases else ""
    head = f"{decorators}class {node.name}{of}:"
    return head + ("".join(f"\n    {line}".rstrip(" ") for line in body) or " ...")


def _is_inner(base: str, module: str) -> bool:
    """Whether a base class is one of ours that its package does not offer."""
    thing = getattr(sys.modules[module], base, None)
    if not inspect.isclass(thing) or thing.__module__.partition(".")[0] not in PACKAGES:
        return False
    return base not in getattr(sys.modules[thing.__module__.rpartition(".")[0]], "__all__", ())


def _field(node: ast.AnnAssign, module: str) -> str:
    value = node.value
    if isinstance(value, ast.Call) and ast.unparse(value.func) == "field":
        value = next((word.value for word in value.keywords if word.arg == "default"), value)
    told = "" if value is None else f" = {_default(value, module)}"
    return f"{ast.unparse(node.target)}: {plain_type(node.annotation, module)}{told}"


def _signature(node: ast.FunctionDef, module: str) -> str:
    """`def name(...) -> type: ...`, of one line or with a line for each parameter."""
    given, words = node.args, []
    positional = [*given.posonlyargs, *given.args]
    defaults = [None] * (len(positional) - len(given.defaults)) + given.defaults
    for argument, default in zip(positional, defaults, strict=True):
        words.append(_parameter(argument, default, module))
    if given.vararg:
        words.append("*" + _parameter(given.vararg, None, module))
    elif given.kwonlyargs:
        words.append("*")
    for argument, default in zip(given.kwonlyargs, given.kw_defaults, strict=True):
        words.append(_parameter(argument, default, module))
    if given.kwarg:
        words.append("**" + _parameter(given.kwarg, None, module))
    if given.posonlyargs:
        words.insert(len(given.posonlyargs), "/")
    end = f") -> {plain_type(node.returns, module)}: ..."
    line = f"def {node.name}({', '.join(words)}{end}"
    return line if len(line) <= WIDTH else f"def {node.name}(\n" + "".join(f"    {w},\n" for w in words) + end


def _parameter(argument: ast.arg, default: ast.expr | None, module: str) -> str:
    kind = f": {plain_type(argument.annotation, module)}" if argument.annotation else ""
    sign = " = " if kind else "="
    return argument.arg + kind + ("" if default is None else sign + _default(default, module))


def _default(value: ast.expr, module: str) -> str:
    """The value where it is a plain constant, else its name."""
    if isinstance(value, ast.Name):
        found = getattr(sys.modules[module], value.id, None)
        if isinstance(found, int | float | str):
            return repr(found)
    return ast.unparse(value)
