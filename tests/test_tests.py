"""What holds of the tests themselves: helpers live in modules without tests, and nothing private of the product is looked at."""

import ast
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

from tests.files import ROOT

FILES = sorted((ROOT / "tests").rglob("*.py"))
SETTERS = ("setattr", "getattr", "delattr", "hasattr")

#: Whose tests still look at something private; it is to become empty.
PRIVATE = {"tests/board/test_learning.py"}


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def borrowed(tree: ast.AST) -> Iterator[str]:
    """The modules with tests from which a file imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("tests"):
            names = [*(node.module or "").split("."), *(alias.name for alias in node.names)]
            yield from (name for name in names[1:] if name.startswith("test_"))


def private(tree: ast.AST) -> Iterator[str]:
    """The private names of others that a file imports, reads or sets; its own objects are `self` and `cls`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_private(node.attr):
            if not (isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")):
                yield node.attr
        elif isinstance(node, ast.ImportFrom):
            yield from (alias.name for alias in node.names if is_private(alias.name))
        elif isinstance(node, ast.Call) and called(node.func) in SETTERS:
            texts = [
                argument.value
                for argument in node.args
                if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
            ]
            yield from (text for text in texts if is_private(text.rpartition(".")[2]))


def called(function: ast.expr) -> str:
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def by_file(what: Callable[[ast.AST], Iterator[str]]) -> dict[str, list[str]]:
    by_file = {path: list(what(parsed(path))) for path in FILES}
    return {str(path.relative_to(ROOT)): names for path, names in by_file.items() if names}


def test_nobody_imports_from_a_module_with_tests() -> None:
    assert by_file(borrowed) == {}


def test_nothing_private_of_the_product_is_looked_at() -> None:
    assert {path: names for path, names in by_file(private).items() if path not in PRIVATE} == {}


def test_a_module_without_tests_says_in_its_first_sentence_what_it_is_for() -> None:
    silent = [path for path in FILES if not ast.get_docstring(parsed(path))]
    assert [str(path.relative_to(ROOT)) for path in silent if path.read_text(encoding="utf-8").strip()] == []


def test_what_it_looks_for_is_found() -> None:
    tree = ast.parse("from tests.a.test_b import c\nfrom tests.a import test_d\nx._y\nself._z\nm.setattr(x, '_w', 1)\n")
    assert list(borrowed(tree)) == ["test_b", "test_d"]
    assert sorted(private(tree)) == ["_w", "_y"]
