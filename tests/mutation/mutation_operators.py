"""Small changes to the bodies of a module's functions, each of which its tests should notice.

What is only said (docstrings, the words of errors, annotations, failpoints) is left as it is, and so are a module's
tables and defaults: tests compare them with what is written elsewhere.
"""

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import CodeType

__all__ = ["Mutant", "code_of", "mutants", "telling"]

_COMPARE: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_BINARY: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.FloorDiv: ast.Mult,
    ast.Div: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.Pow: ast.Mult,
}
_SWAPPED = {"min": "max", "max": "min", "any": "all", "all": "any"}
#: Calls whose arguments are words for people, or do nothing.
_WORDS = (
    "Error",
    "InvalidInput",
    "_damage",
    "_malformed",
    "_disk_error",
    "_not_found",
    "unreadable",
    "_freezing",
    "failpoint",
    "cast",
)


@dataclass(frozen=True)
class Mutant:
    """One changed module.

    Attributes
    ----------
    function : str
        Qualified name of the function that differs.
    line : int
        Of that function's definition.
    key : str
        Function and change, and which one of equal ones: stays the same when other code moves.
    tree : ast.Module
    """

    function: str
    line: int
    key: str
    tree: ast.Module


Change = Callable[[ast.AST], ast.AST | None]


def mutants(source: str) -> Iterator[Mutant]:
    """All mutants of a module, in the order of its lines."""
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    for function, name in _functions(tree):
        for path in _places(function):
            for change in _changes(_at(function, path)):
                mutated = ast.parse(source)  # quicker than a copy
                before, after = _apply(mutated, (function.lineno, function.name), path, change)
                key = f"{name}: {before} → {after}"
                seen[key] += 1
                number = f" ({seen[key]})" if seen[key] > 1 else ""
                yield Mutant(name, _first_line(function), key + number, ast.fix_missing_locations(mutated))


def code_of(mutant: Mutant, filename: str) -> CodeType:
    """The compiled function that differs."""
    return _find(compile(mutant.tree, filename, "exec", dont_inherit=True), mutant.function, mutant.line)


def telling(source: str, filename: str, told: str) -> Iterator[tuple[int, CodeType]]:
    """Each function of a module that first adds "file:first line" to the set ``told``, after that line."""
    tree = ast.parse(source)
    functions = list(_functions(tree))
    for function, _ in functions:
        tell = ast.parse(f"{told}.add({f'{filename}:{_first_line(function)}'!r})").body[0]
        for node in ast.walk(tell):
            ast.copy_location(node, function)
        function.body.insert(0, tell)
    code = compile(tree, filename, "exec", dont_inherit=True)
    for function, name in functions:
        yield _first_line(function), _find(code, name, _first_line(function))


def _find(code: CodeType, name: str, line: int) -> CodeType:
    """The function of this qualified name and first line in a module's code."""

    def find(code: CodeType) -> CodeType | None:
        if (code.co_qualname, code.co_firstlineno) == (name, line):
            return code
        inner = (find(each) for each in code.co_consts if isinstance(each, CodeType))
        return next((each for each in inner if each is not None), None)

    found = find(code)
    if found is None:
        raise LookupError(f"there is no function {name} in line {line}")
    return found


# --- where -----------------------------------------------------------------------------------------------------------

_Function = ast.FunctionDef | ast.AsyncFunctionDef
_Path = tuple[tuple[str, int | None], ...]


def _functions(tree: ast.Module) -> Iterator[tuple[_Function, str]]:
    """Functions and methods with their qualified names; functions inside functions belong to these."""

    def walk(body: list[ast.stmt], prefix: str) -> Iterator[tuple[_Function, str]]:
        for node in body:
            if isinstance(node, _Function):
                yield node, prefix + node.name
            elif isinstance(node, ast.ClassDef) and not any(_name(base) == "Protocol" for base in node.bases):
                yield from walk(node.body, f"{prefix}{node.name}.")

    yield from walk(tree.body, "")


def _first_line(function: _Function) -> int:
    """As its code object has it."""
    return min([function.lineno, *(decorator.lineno for decorator in function.decorator_list)])


def _places(function: _Function) -> Iterator[_Path]:
    """Paths to the nodes of the body that may be changed."""
    for number, statement in enumerate(function.body):
        if number == 0 and _is_docstring(statement):
            continue
        yield from _walk(statement, (("body", number),))


def _walk(node: ast.AST, path: _Path) -> Iterator[_Path]:
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Call) and _name(node.func).endswith(_WORDS)):
        return
    if isinstance(node, ast.keyword) and node.arg == "strict":  # of a zip: says what is so, and does nothing
        return
    yield path
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "args") and not isinstance(node, ast.Call):
            continue
        if isinstance(value, ast.AST):
            yield from _walk(value, (*path, (name, None)))
        elif isinstance(value, list):
            for number, each in enumerate(value):
                if isinstance(each, ast.AST) and not (name == "body" and number == 0 and _is_docstring(each)):
                    yield from _walk(each, (*path, (name, number)))


def _at(node: ast.AST, path: _Path) -> ast.AST:
    for name, number in path:
        node = getattr(node, name) if number is None else getattr(node, name)[number]
    return node


def _apply(tree: ast.Module, function: tuple[int, str], path: _Path, change: Change) -> tuple[str, str]:
    """Change the node of the copied tree; source before and after."""
    start = next(
        node for node in ast.walk(tree) if isinstance(node, _Function) and (node.lineno, node.name) == function
    )
    parent, (name, number) = _at(start, path[:-1]), path[-1]
    node = _at(parent, path[-1:])
    before = _brief(node)
    after = change(node) or node
    ast.copy_location(after, node)
    if number is None:
        setattr(parent, name, after)
    else:
        getattr(parent, name)[number] = after
    return before, _brief(after)


def _brief(node: ast.AST) -> str:
    """Its source in one line; of a compound statement the head."""
    return ast.unparse(node).splitlines()[0]


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _name(node: ast.AST) -> str:
    return getattr(node, "id", "") or getattr(node, "attr", "")


# --- what ------------------------------------------------------------------------------------------------------------


def _changes(node: ast.AST) -> Iterator[Change]:
    """What may become of a node; each change takes a copy of it, and gives what takes its place or alters it."""
    if isinstance(node, ast.Compare):
        yield from _compared(node)
    elif isinstance(node, ast.BoolOp):
        yield lambda n: _set(n, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        yield lambda n: _set(n, op=_BINARY[type(node.op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield lambda n: n.operand  # type: ignore[attr-defined]
    elif isinstance(node, ast.Call) and _name(node.func) in _SWAPPED and isinstance(node.func, ast.Name):
        yield lambda n: _set(n, func=ast.Name(_SWAPPED[_name(node.func)], ast.Load()))
    elif isinstance(node, ast.Constant):
        yield from _constants(node)
    elif isinstance(node, ast.If | ast.While | ast.IfExp) and not isinstance(node.test, ast.Compare | ast.UnaryOp):
        yield lambda n: _set(n, test=ast.UnaryOp(ast.Not(), n.test))  # type: ignore[attr-defined]
    elif isinstance(node, ast.stmt):
        yield from _statements(node)


def _compared(node: ast.Compare) -> Iterator[Change]:
    for number, operator in enumerate(node.ops):
        for other in _COMPARE[type(operator)]:
            yield lambda n, number=number, other=other: _set(
                n, ops=[other() if k == number else each for k, each in enumerate(node.ops)]
            )


def _constants(node: ast.Constant) -> Iterator[Change]:
    value = node.value
    if isinstance(value, bool):
        yield lambda n: _set(n, value=not value)
    elif isinstance(value, int):
        yield lambda n: _set(n, value=value + 1)
    elif isinstance(value, str | bytes) and value and node.kind is None:
        word = "x" if isinstance(value, str) else b"x"
        yield lambda n: _set(n, value=word + value)  # type: ignore[operator]


def _statements(node: ast.stmt) -> Iterator[Change]:
    """Left out, or returning nothing."""
    if isinstance(node, ast.Return) and node.value is not None and not _is_none(node.value):
        yield lambda n: _set(n, value=ast.Constant(None))
    elif (isinstance(node, ast.Expr) and isinstance(node.value, ast.Call | ast.Yield | ast.YieldFrom)) or isinstance(
        node, ast.Raise | ast.AugAssign | ast.Delete
    ):
        if not (isinstance(node, ast.Expr) and _name(getattr(node.value, "func", node)).endswith(_WORDS)):
            yield lambda n: ast.Pass()
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Attribute | ast.Subscript):
        yield lambda n: ast.Pass()
    elif isinstance(node, ast.Continue | ast.Break):
        yield lambda n: ast.Break() if isinstance(node, ast.Continue) else ast.Continue()


def _is_none(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and node.value is None


def _set(node: ast.AST, **values: object) -> ast.AST:
    for name, value in values.items():
        setattr(node, name, value)
    return node
