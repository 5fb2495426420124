"""The names that docstrings list under ``Args:`` and ``Attributes:`` exist, also after a parameter was renamed."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDERS = ("core", "plugins", "papers")
SECTION = re.compile(r"(Args|Attributes):")
Function = ast.FunctionDef | ast.AsyncFunctionDef


def indent_of(line: str) -> int:
    return len(line) - len(line.lstrip())


def documented_names(docstring: str) -> Iterator[str]:
    """Yield the names before the colon of each entry of the two sections: ``a, b: …`` has two."""
    section = entry = -1
    for line in docstring.splitlines():
        if not line.strip():
            continue
        if SECTION.fullmatch(line.strip()):
            section, entry = indent_of(line), -1
        elif section >= 0 and indent_of(line) > section:
            entry = indent_of(line) if entry < 0 else entry
            if indent_of(line) == entry:
                yield from (name.strip().lstrip("*") for name in line.partition(":")[0].split(","))
        else:
            section = -1


def parameters(function: Function) -> set[str]:
    given = function.args
    named = [*given.posonlyargs, *given.args, *given.kwonlyargs, *filter(None, (given.vararg, given.kwarg))]
    return {each.arg for each in named}


def members(cls: ast.ClassDef, classes: Mapping[str, ast.ClassDef]) -> set[str]:
    """Return fields, methods, parameters of ``__init__`` and attributes set on self, those of bases too."""
    found: set[str] = set()
    for node in ast.walk(cls):
        match node:
            case ast.AnnAssign(target=ast.Name(name)) | ast.Name(name, ctx=ast.Store()):
                found.add(name)
            case ast.Attribute(ast.Name("self"), name, ctx=ast.Store()):
                found.add(name)
            case ast.FunctionDef() | ast.AsyncFunctionDef():
                found |= {node.name} | (parameters(node) if node.name == "__init__" else set())
    for base in cls.bases:
        plain = base.value if isinstance(base, ast.Subscript) else base
        name = plain.id if isinstance(plain, ast.Name) else plain.attr if isinstance(plain, ast.Attribute) else ""
        if name in classes and classes[name] is not cls:
            found |= members(classes[name], classes)
    return found


def test_every_name_that_a_docstring_describes_exists() -> None:
    trees = {
        path: ast.parse(path.read_text("utf-8")) for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))
    }
    classes = {node.name: node for tree in trees.values() for node in ast.walk(tree) if isinstance(node, ast.ClassDef)}
    described, wrong = 0, []
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.ClassDef | Function):
                continue
            names = list(documented_names(ast.get_docstring(node) or ""))
            known = members(node, classes) if isinstance(node, ast.ClassDef) and names else set()
            known |= set() if isinstance(node, ast.ClassDef) else parameters(node)
            described += len(names)
            where = f"{path.relative_to(ROOT)}:{node.lineno}: {node.name}"
            wrong += [f"{where} has no {name!r}" for name in names if name not in known]
    assert described > 1000
    assert wrong == []


OTHER_LIBRARIES = ("mcap.", "numpy.", "struct", "tomllib")


def test_every_cross_reference_in_a_docstring_leads_somewhere() -> None:
    sources = {path: path.read_text("utf-8") for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))}
    modules = {part for path in sources for part in (path.stem, path.parent.name)}
    text = "\n".join(sources.values())
    defined = set(re.findall(r"(?:\b(?:def|class)\s+|^\s*|\bself\.)(\w+)\b(?=\s*[(:=\[])", text, re.MULTILINE))
    wrong = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, source in sources.items()
        for name in re.findall(r":(?:class|func|mod|meth|data|attr|exc):`~?([\w.]+)`", source)
        if not name.startswith(OTHER_LIBRARIES) and name.rpartition(".")[2] not in defined | modules
    ]
    assert wrong == []
