"""The types of signatures, read from the source: what is in memory prints differently with each Python and numpy."""

import ast
import importlib
import inspect
from functools import cache

from data.common.build import PACKAGES


def plain_type(annotation: ast.expr | None, module: str) -> str:
    """An annotation as it stands in a module, in words that are known outside of it."""
    if annotation is None:
        return "None"
    return ast.unparse(_Plain(module).visit(ast.parse(ast.unparse(annotation), mode="eval").body))


class _Plain(ast.NodeTransformer):
    """Puts what they stand for in the place of quotes and of our own aliases."""

    def __init__(self, module: str) -> None:
        self.module = module

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return self.visit(ast.parse(node.value, mode="eval").body) if isinstance(node.value, str) else node

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        of = ast.unparse(node.value)
        if of == "Annotated" and isinstance(node.slice, ast.Tuple):
            return self.visit(node.slice.elts[0])
        return node if of == "Literal" else self.generic_visit(node)

    def visit_Name(self, node: ast.Name) -> ast.AST:
        alias = _alias(self.module, node.id)
        return node if alias is None else _Plain(alias[0]).visit(ast.parse(alias[1], mode="eval").body)


@cache
def _alias(module: str, name: str) -> tuple[str, str] | None:
    """The module and text of what a name is an alias of; None of classes and of what is not ours."""
    for node in ast.walk(tree(module)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] in PACKAGES:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return _alias(node.module, alias.name)
    for node in tree(module).body:
        if not isinstance(node, ast.Assign) or [ast.unparse(target) for target in node.targets] != [name]:
            continue
        return (module, ast.unparse(node.value)) if isinstance(node.value, ast.Subscript | ast.BinOp) else None
    return None


@cache
def tree(module: str) -> ast.Module:
    """The source of a module."""
    return ast.parse(inspect.getsource(importlib.import_module(module)))
