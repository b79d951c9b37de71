"""The expressions of a stage function, with what is known of its arguments."""

import ast
import builtins
import inspect
from types import FunctionType, ModuleType
from typing import Any

from cable_envs.core import kernels
from cable_envs.standalone.program import (
    COLUMN,
    INTRINSIC,
    LANES,
    NONE,
    TILES,
    Group,
    Known,
    NotTranslated,
    Row,
    Tile,
)


class Values:
    """Expressions of one function; a value is known before the program runs, or an expression of the program.

    Attributes
    ----------
    maker : object
        Makes the functions that it calls, and keeps the named constants (`cable_envs.standalone.specialise`).
    function : function
        The stage function.
    stored : list of str
        Names that it assigns to, each as often as it does.
    env : dict of str to object
        What is known of its names; None: a number of the program.
    tiles : set of str
        Records that it needs.
    """

    maker: Any
    function: Any
    stored: list[str]
    env: dict[str, Any]
    tiles: set[str]

    def refused(self, node: ast.AST, what: str) -> NotTranslated:
        """The error for a construct, with its place."""
        line = self.function.__code__.co_firstlineno + getattr(node, "lineno", 1) - 1
        where = f"{self.function.__module__}.{self.function.__name__}, line {line}"
        return NotTranslated(f"{where}: {what} cannot be exported")

    def lifted(self, value: Any, node: ast.AST) -> ast.expr:
        """A value as the program writes it."""
        if isinstance(value, ast.expr):
            return value
        if isinstance(value, Known) and isinstance(value.value, (bool, int, float)):
            if value.name:
                return name_of(self.maker.constant(value.name, value.value))
            return ast.Constant(value.value)
        raise self.refused(node, f"{value} as a number")

    def value(self, node: ast.expr) -> Any:
        """What an expression is: known, or an expression of the program."""
        method = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refused(node, f"the expression '{type(node).__name__}'")
        return method(node)

    def _of_given(self, node: "Given") -> Any:
        return Known(node.value)

    def _of_constant(self, node: ast.Constant) -> Any:
        return Known(node.value)

    def _of_name(self, node: ast.Name) -> Any:
        if node.id in self.env:
            value = self.env[node.id]
            return name_of(safe_name(node.id)) if value is None else value
        if node.id in self.stored:
            return name_of(safe_name(node.id))
        value = self.function.__globals__.get(node.id, getattr(builtins, node.id, None))
        if isinstance(value, (bool, int, float)):
            return Known(value, node.id)
        return Known(value)

    def _of_attribute(self, node: ast.Attribute) -> Any:
        base = self.value(node.value)
        if isinstance(base, Tile) and node.attr in base.counts:
            return Row(base.name, node.attr, base.counts[node.attr])
        if isinstance(base, Group):
            return dict(base.fields)[node.attr]
        if isinstance(base, Row) and node.attr == "shape":
            return (Known(base.count), LANES) if base.count >= 0 else (LANES,)
        if isinstance(base, Known) and isinstance(base.value, ModuleType):
            return Known(getattr(base.value, node.attr))
        raise self.refused(node, f"'.{node.attr}'")

    def _of_subscript(self, node: ast.Subscript) -> Any:
        base = self.value(node.value)
        index = node.slice
        if isinstance(base, Row):
            return self._at(
                base, [self.value(n) for n in (index.elts if isinstance(index, ast.Tuple) else [index])], node
            )
        at = self.value(index)
        if isinstance(base, tuple) and isinstance(at, Known):
            return base[at.value]
        if isinstance(base, ast.expr):
            return ast.Subscript(base, self.lifted(at, node), ast.Load())
        raise self.refused(node, "this index")

    def _at(self, row: Row, index: list[Any], node: ast.AST) -> Any:
        self.tiles.add(row.tile)
        place = ast.Attribute(name_of(TILES[row.tile]), row.field, ast.Load())
        if row.count < 0 and index == [COLUMN]:
            return place
        if row.k >= 0 and index == [COLUMN]:
            return ast.Subscript(place, ast.Constant(row.k), ast.Load())
        if row.count >= 0 and len(index) == 2 and index[1] == COLUMN:
            return ast.Subscript(place, self.lifted(index[0], node), ast.Load())
        if row.count >= 0 and row.k < 0 and len(index) == 1 and isinstance(index[0], Known):
            return Row(row.tile, row.field, row.count, index[0].value)
        raise self.refused(node, "this index")

    def _of_tuple(self, node: ast.Tuple) -> Any:
        return ast.Tuple([self.lifted(self.value(n), n) for n in node.elts], ast.Load())

    def _of_binop(self, node: ast.BinOp) -> Any:
        left, right = self.value(node.left), self.value(node.right)
        if _whole(left) and _whole(right):
            return Known(_folded(ast.BinOp(ast.Constant(left.value), node.op, ast.Constant(right.value))))
        return ast.BinOp(self.lifted(left, node), node.op, self.lifted(right, node))

    def _of_unaryop(self, node: ast.UnaryOp) -> Any:
        value = self.value(node.operand)
        if isinstance(value, Known) and not value.name:
            return Known(_folded(ast.UnaryOp(node.op, ast.Constant(value.value))))
        return ast.UnaryOp(node.op, self.lifted(value, node))

    def _of_compare(self, node: ast.Compare) -> Any:
        values = [self.value(n) for n in (node.left, *node.comparators)]
        if isinstance(node.ops[0], (ast.Is, ast.IsNot)):
            same = values[0] == NONE
            return Known(same if isinstance(node.ops[0], ast.Is) else not same)
        if all(_whole(v) for v in values) and len(values) == 2:
            ends = [ast.Constant(v.value) for v in values]
            return Known(_folded(ast.Compare(ends[0], node.ops, [ends[1]])))
        first, *others = [self.lifted(v, node) for v in values]
        return ast.Compare(first, node.ops, others)

    def _of_boolop(self, node: ast.BoolOp) -> Any:
        stops, found = isinstance(node.op, ast.Or), []
        for value in map(self.value, node.values):
            if isinstance(value, Known):
                if bool(value.value) == stops:
                    found.append(value)
                    break
                continue
            found.append(value)
        if not found:
            return Known(not stops)
        if len(found) == 1:
            return found[0]
        return ast.BoolOp(node.op, [self.lifted(v, node) for v in found])

    def _of_ifexp(self, node: ast.IfExp) -> Any:
        test = self.value(node.test)
        if isinstance(test, Known):
            return self.value(node.body if test.value else node.orelse)
        a, b = self.value(node.body), self.value(node.orelse)
        return ast.IfExp(self.lifted(test, node), self.lifted(a, node), self.lifted(b, node))

    def _of_call(self, node: ast.Call) -> Any:
        callee = self.value(node.func)
        if not isinstance(callee, Known):
            raise self.refused(node, "this call")
        function = plain(callee.value)
        name = getattr(function, "__name__", "") or getattr(function, "_name", "")
        given = [self.value(a) for a in node.args]
        if isinstance(function, type) and hasattr(function, "_fields"):
            return Group(tuple(zip(function._fields, given, strict=True)))
        if function is plain(kernels.apart):
            return given[0]
        for known in (*self.maker.elementary, *INTRINSIC):
            if function is plain(getattr(kernels, known)):
                return call_of(known.lstrip("_"), [self.lifted(v, node) for v in given])
        if function in (abs, min, max):
            return call_of(name, [self.lifted(v, node) for v in given])
        if getattr(function, "__module__", "").partition(".")[0] == "numpy" or type(function).__name__ == "ufunc":
            return self._of_numpy(name, given, node)
        if isinstance(function, FunctionType):
            return self._called(function, given, node)
        raise self.refused(node, f"a call of '{name or function}'")

    def _of_numpy(self, name: str, given: list[Any], node: ast.Call) -> Any:
        if name in ("zeros", "empty") and len(given) == 1:
            length = self.lifted(given[0], node)
            return ast.BinOp(ast.List([ast.Constant(0.0)], ast.Load()), ast.Mult(), length)
        if name == "sign":
            return self._of_call(ast.Call(Given(kernels.sign), node.args, []))
        raise self.refused(node, f"numpy.{name}")

    def _called(self, function: FunctionType, given: list[Any], node: ast.Call) -> Any:
        bound = inspect.signature(function).bind(*given, **{k.arg or "": self.value(k.value) for k in node.keywords})
        for parameter in inspect.signature(function).parameters.values():
            if parameter.name not in bound.arguments:
                bound.arguments[parameter.name] = Known(parameter.default)
        names = list(inspect.signature(function).parameters)
        stored = {
            n.id
            for n in ast.walk(self.maker.source(function))
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        }
        values = [bound.arguments[name] for name in names]
        known = [
            None
            if isinstance(v, ast.expr) or (isinstance(v, Known) and (isinstance(v.value, float) or n in stored))
            else v
            for n, v in zip(names, values, strict=True)
        ]
        made = self.maker.made(function, known)
        passed = {n: self.lifted(v, node) for n, v, k in zip(names, values, known, strict=True) if k is None}
        if isinstance(made.constant, str):
            return passed[made.constant]
        if made.constant is not None:
            return made.constant
        if not made.node.body:
            return NONE
        self.tiles |= set(made.tiles)
        return call_of(made.node.name, [*(name_of(TILES[t]) for t in made.tiles), *passed.values()])


class Given(ast.expr):
    """A value in the place of an expression."""

    _fields = ()

    def __init__(self, value: Any):
        super().__init__()
        self.value = value


def plain(function: Any) -> Any:
    """The Python function of a compiled one."""
    return getattr(function, "py_func", function)


def _whole(value: Any) -> bool:
    return isinstance(value, Known) and isinstance(value.value, (bool, int))


def _folded(node: ast.expr) -> Any:
    return eval(compile(ast.fix_missing_locations(ast.Expression(node)), "<known>", "eval"))  # two whole numbers


def safe_name(name: str) -> str:
    """A local name that is none of a record."""
    return f"{name}_" if name in TILES.values() else name


def name_of(name: str, context: ast.expr_context | None = None) -> ast.Name:
    """A name in the program."""
    return ast.Name(name, context or ast.Load())


def call_of(name: str, arguments: list[ast.expr]) -> ast.Call:
    """A call in the program."""
    return ast.Call(name_of(name), arguments, [])
