"""The prose of a source file: comments, docstrings and pages, each line with its number."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

#: Comments of languages whose strings may hold anything: a string or a comment, whichever begins first.
_C = re.compile(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|(?P<comment>/\*.*?\*/|//[^\n]*)', re.DOTALL)
_FORTRAN = re.compile(r'"[^"\n]*"|\'[^\'\n]*\'|(?P<comment>![^\n]*)')
_HASH = re.compile(r'"(?:\\.|[^"\\\n])*"|\'[^\'\n]*\'|(?P<comment>(?:(?<=\s)|^)#[^\n]*)', re.MULTILINE)
_COMMENTS = {
    **dict.fromkeys([".c", ".h", ".cpp", ".hpp", ".C", ".H", ".js", ".css"], _C),
    **dict.fromkeys([".f90"], _FORTRAN),
    **dict.fromkeys([".sh", ".toml", ".yml", ".yaml", ".cmake", ".cfg", ".in"], _HASH),
    **dict.fromkeys(["Makefile", "Dockerfile", "CMakeLists.txt", "Allwmake", "run"], _HASH),
}
#: Code within a line, addresses of links, tags.
_CODE = re.compile(r"(`+).*?\1|\]\([^)]*\)|<[^>]*>")

Lines = Iterator[tuple[int, str]]


def prose(path: Path) -> list[tuple[int, str]]:
    """Line numbers from 1 and the text of each line of prose; nothing for a file of another kind."""
    return [(number, _CODE.sub(" ", line)) for number, line in _lines(path)]


def _lines(path: Path) -> Lines:
    comment = _COMMENTS.get(path.suffix) or _COMMENTS.get(path.name)
    if path.suffix == ".md":
        yield from _page(path.read_text(encoding="utf-8"))
    elif path.suffix == ".py":
        yield from _python(path.read_text(encoding="utf-8"))
    elif comment is not None:
        yield from _comments(comment, path.read_text(encoding="utf-8"))


def _page(text: str) -> Lines:
    """A page without its blocks of code."""
    is_code = False
    for number, line in enumerate(text.splitlines(), 1):
        is_code ^= line.lstrip().startswith("```")
        if not is_code:
            yield number, line


def _python(text: str) -> Lines:
    """Comments, and the docstrings of modules, classes and functions."""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string
    for node in ast.walk(ast.parse(text)):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        if documented and ast.get_docstring(node, clean=False) is not None:
            lines = text.splitlines()[node.body[0].lineno - 1 : node.body[0].end_lineno]
            yield from enumerate(lines, node.body[0].lineno)


def _comments(comment: re.Pattern[str], text: str) -> Lines:
    for found in comment.finditer(text):
        if found["comment"]:
            first = text.count("\n", 0, found.start()) + 1
            yield from enumerate(found["comment"].splitlines(), first)
