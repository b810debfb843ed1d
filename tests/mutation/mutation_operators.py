"""Small changes to the bodies of a module's functions, each of which its tests should notice.

What is only said (docstrings, the words of errors, annotations, failpoints) is left as it is, and so are a module's
tables and defaults: tests compare them with what is written elsewhere.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from copy import copy
from types import CodeType
from typing import Any, NamedTuple

__all__ = ["Mutant", "mutants"]

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
    *("Error", "InvalidInput", "_damage", "_malformed", "_disk_error", "_not_found", "unreadable"),
    *("_freezing", "failpoint", "cast"),
)


class Mutant(NamedTuple):
    """A changed function: qualified name, first line, what is changed (stays when other code moves), and its code."""

    function: str
    line: int
    key: str
    code: CodeType


def mutants(source: str, filename: str) -> Iterator[Mutant]:
    """All mutants of a module, in the order of its lines."""
    tree = ast.parse(source)
    seen: Counter[str] = Counter()
    for function, name in _functions(tree.body):
        line = min(node.lineno for node in (function, *function.decorator_list))
        for fields, place in list(_places(function)):
            node = fields[place]
            for other in _others(node):
                key = f"{name}: {_brief(node)} → {_brief(other)}"
                seen[key] += 1
                fields[place] = ast.fix_missing_locations(ast.copy_location(other, node))
                codes = _codes(compile(tree, filename, "exec", dont_inherit=True))
                fields[place] = node
                code = next(each for each in codes if (each.co_qualname, each.co_firstlineno) == (name, line))
                yield Mutant(name, line, key + (f" ({seen[key]})" if seen[key] > 1 else ""), code)


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Of a module, its classes, and all functions."""
    yield code
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _codes(each)


# --- where -----------------------------------------------------------------------------------------------------------

_Function = ast.FunctionDef | ast.AsyncFunctionDef


def _functions(body: list[ast.stmt], prefix: str = "") -> Iterator[tuple[_Function, str]]:
    """Functions and methods with their qualified names; functions inside functions belong to these."""
    for node in body:
        if isinstance(node, _Function):
            yield node, prefix + node.name
        elif isinstance(node, ast.ClassDef) and not any(_name(base) == "Protocol" for base in node.bases):
            yield from _functions(node.body, f"{prefix}{node.name}.")


def _places(node: ast.AST) -> Iterator[tuple[Any, Any]]:
    """Where what is below a node may be changed: a list or the fields of a node, and the index or the name in it."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "args") and not isinstance(node, ast.Call):
            continue
        for place, each in enumerate(value) if isinstance(value, list) else [(name, value)]:
            if isinstance(each, ast.AST) and not _is_said(each) and not (name == "body" and _is_docstring(each)):
                yield value if isinstance(value, list) else vars(node), place
                yield from _places(each)


def _is_said(node: ast.AST) -> bool:
    """Words for people; and the ``strict`` of a zip, which says what is so."""
    match node:
        case ast.Call(func=func):
            return _name(func).endswith(_WORDS)
        case ast.JoinedStr() | ast.keyword(arg="strict"):
            return True
    return False


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _name(node: ast.AST) -> str:
    return getattr(node, "id", "") or getattr(node, "attr", "")


def _brief(node: ast.AST) -> str:
    """Its source in one line; of a compound statement the head."""
    return ast.unparse(node).splitlines()[0]


# --- what ------------------------------------------------------------------------------------------------------------


def _others(node: ast.AST) -> Iterator[ast.AST]:  # noqa: PLR0912  a table of shapes
    """What may stand in a node's place."""
    match node:
        case ast.Compare(ops=ops):
            for number, operator in enumerate(ops):
                for other in _COMPARE[type(operator)]:
                    yield _but(node, ops=[*ops[:number], other(), *ops[number + 1 :]])
        case ast.BoolOp(op=op):
            yield _but(node, op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.BinOp(op=op) if type(op) in _BINARY:
            yield _but(node, op=_BINARY[type(op)]())
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Call(func=ast.Name(id=name)) if name in _SWAPPED:
            yield _but(node, func=ast.Name(_SWAPPED[name], ast.Load()))
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int(value)):
            yield ast.Constant(value + 1)
        case ast.Constant(value=str(value) | bytes(value)) if value:
            yield ast.Constant("x" + value if isinstance(value, str) else b"x" + value)
        case ast.If(test=test) | ast.While(test=test) | ast.IfExp(test=test):
            if not isinstance(test, ast.Compare | ast.UnaryOp):
                yield _but(node, test=ast.UnaryOp(ast.Not(), test))
        case ast.Return(value=ast.expr() as value) if _brief(value) != "None":
            yield ast.Return(ast.Constant(None))
        case ast.Expr(value=ast.Call() | ast.Yield() | ast.YieldFrom() as value) if not _is_said(value):
            yield ast.Pass()
        case ast.Raise() | ast.AugAssign() | ast.Delete():
            yield ast.Pass()
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript(), *_]):
            yield ast.Pass()
        case ast.Continue() | ast.Break():
            yield ast.Break() if isinstance(node, ast.Continue) else ast.Continue()


def _but(node: ast.AST, **values: object) -> ast.AST:
    """The same node, but for these fields."""
    other = copy(node)
    vars(other).update(values)
    return other
