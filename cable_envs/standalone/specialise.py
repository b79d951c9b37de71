"""The stages of a plant's kernel as a program of plain functions on numbers, for one mechanism.

The simulator compiles scalar functions that work on columns of tiles (`cable_envs.core.lanes`). Here the same functions
are read from their source, and what is known before they run is left out: the column, which tile an argument is, how
many contacts there are, whether there are effects. What remains is Python of a few constructs on floats, whole numbers,
truth values and the named rows of seven records (`TILES`). `cable_envs.standalone.python_text` prints it, and
`cable_envs.standalone.c_text` translates it. No formula is written here.
"""

import ast
import builtins
import inspect
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import FunctionType, ModuleType
from typing import Any

from cable_envs.core import kernels
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.lanes import Lanes

TILES = {
    "x": "signals", "p": "rig", "u": "inputs", "w": "scratch", "e": "effects", "s": "states", "g": "control",
}  # fmt: skip
"""The records of a program, by the names that `cable_envs.plants.base.Plant.solve` has for them."""

ELEMENTARY = ("select", "minimum", "maximum", "clip", "sign", "sqrt", "exp", "expm1", "log", "power", "sine_cosine")
"""Functions of `cable_envs.core.kernels` that a program may leave to whoever prints it."""

INTRINSIC = ("select", "sqrt", "_fma", "to_bits", "from_bits", "_shift_right_52")
"""Those that have no source of their own."""


TOP = "control_step"
"""Name of the function of a program that calls all others."""


class NotTranslated(ConfigurationError):
    """A stage function has a construct that an export does not know."""


@dataclass(frozen=True)
class Tile:
    """One of the records."""

    name: str
    lanes: Lanes = field(compare=False, hash=False)


@dataclass(frozen=True)
class Row:
    """A field of a record: a number, or a sequence of ``count`` numbers; of these the k-th where ``k`` is not below 0."""

    tile: str
    field: str
    count: int = -1
    k: int = -1


@dataclass(frozen=True)
class Group:
    """A named tuple of rows."""

    fields: tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Known:
    """A value that is known before the program runs."""

    value: Any
    name: str = ""


@dataclass(frozen=True)
class Mark:
    """The column that a function works on, or the number of columns."""

    what: str


COLUMN, LANES, NONE = Mark("column"), Mark("lanes"), Known(None)


@dataclass
class Made:
    """A function of the program.

    Attributes
    ----------
    node : ast.FunctionDef
        Its text. It takes the records that it needs, in the order of `TILES`, and then numbers.
    tiles : tuple of str
        The records.
    constant : Known, str or None
        What it always gives: a number, or its argument of that name. None: its text says it.
    origin : str
        Module and name of the function that it is made from.
    """

    node: ast.FunctionDef
    tiles: tuple[str, ...]
    constant: Any
    origin: str


@dataclass
class Program:
    """A plant's kernel for one mechanism.

    Attributes
    ----------
    functions : list of Made
        In an order in which each is defined before it is called; the last is `TOP`, with the arguments
        ``substeps`` and ``dt`` behind its records.
    constants : dict of str to (int or float)
        Named numbers that they read.
    records : dict of str to Lanes
        Fields of the records that the plant has.
    """

    functions: list[Made]
    constants: dict[str, float]
    records: dict[str, Lanes]


def program_of(
    solve: Callable[..., Any], records: Mapping[str, Lanes], effects: bool, elementary: tuple[str, ...] = ELEMENTARY
) -> Program:
    """The program of a kernel.

    Parameters
    ----------
    solve : callable
        `cable_envs.plants.base.Plant.solve` with its hooks filled in.
    records : mapping of str to Lanes
        Fields of the records, by the names in `TILES`.
    effects : bool
        Whether the kernel has effects.
    elementary : tuple of str
        Functions of `cable_envs.core.kernels` that are called by their names instead of being part of the program.

    Returns
    -------
    Program

    Raises
    ------
    NotTranslated
        Names the function, the line and the construct.
    """
    maker = _Maker(elementary)
    statics: list[Any] = [Tile(name, records[name]) for name in ("x", "p", "u", "w")]
    statics += [Tile(name, records[name]) if effects else NONE for name in ("e", "s", "g")]
    made = maker.made(_plain(solve), [*statics, LANES, None, None])
    made.node.name = TOP
    used = {name: lanes for name, lanes in records.items() if effects or name not in ("e", "s", "g")}
    return Program([*maker.finished], maker.constants, used)


def _plain(function: Any) -> Any:
    return getattr(function, "py_func", function)


class _Maker:
    """Makes each function once for every set of what is known of its arguments."""

    def __init__(self, elementary: tuple[str, ...]):
        self.elementary = elementary
        self.finished: list[Made] = []
        self.constants: dict[str, float] = {}
        self._done: dict[Any, Made] = {}
        self._names: dict[str, int] = {TOP: 1}
        self._sources: dict[FunctionType, ast.FunctionDef] = {}

    def source(self, function: FunctionType) -> ast.FunctionDef:
        if function not in self._sources:
            try:
                text = textwrap.dedent(inspect.getsource(function))
                tree = ast.parse(text).body[0]
            except (OSError, TypeError, SyntaxError) as error:
                raise NotTranslated(
                    f"the text of '{function.__name__}' cannot be found; an export needs it"
                ) from error
            if not isinstance(tree, ast.FunctionDef):
                raise NotTranslated(f"'{function.__name__}' is no plain function; an export needs one")
            self._sources[function] = tree
        return self._sources[function]

    def made(self, function: FunctionType, known: list[Any]) -> Made:
        """``known``: for each argument what is known of it, or None."""
        key = function, tuple(known)
        if key not in self._done:
            made = _Body(self, function, known).made()
            if made.constant is None and made.node.body:
                made.node.name = self._name(made.node.name)
                self.finished.append(made)
            self._done[key] = made
        return self._done[key]

    def constant(self, name: str, value: float) -> str:
        """The name under which a program knows a number."""
        own, k = name.lstrip("_"), 1
        while self.constants.get(own, value) != value or type(self.constants.get(own, value)) is not type(value):
            k += 1
            own = f"{name.lstrip('_')}_{k}"
        self.constants[own] = value
        return own

    def _name(self, name: str) -> str:
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name}_{self._names[name]}"


class _Body:
    """One function with what is known of its arguments."""

    def __init__(self, maker: _Maker, function: FunctionType, known: list[Any]):
        self.maker, self.function, self.tree = maker, function, maker.source(function)
        self.stored = [n.id for n in ast.walk(self.tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
        names = [a.arg for a in self.tree.args.args]
        if self.tree.args.vararg or self.tree.args.kwarg or self.tree.args.kwonlyargs:
            raise self.refused(self.tree, "arguments that are not plain")
        self.env: dict[str, Any] = {}
        self.arguments: list[str] = []
        for name, value in zip(names, known, strict=True):
            if value is None:
                self.arguments.append(name)
            self.env[name] = value
        self.tiles: set[str] = set()

    def refused(self, node: ast.AST, what: str) -> NotTranslated:
        line = self.function.__code__.co_firstlineno + getattr(node, "lineno", 1) - 1
        where = f"{self.function.__module__}.{self.function.__name__}, line {line}"
        return NotTranslated(f"{where}: {what} cannot be exported")

    # what is made

    def made(self) -> Made:
        body = self.tree.body
        doc = ast.get_docstring(self.tree)
        live = _needed(self.block(body[1:] if doc is not None else body), self.maker.elementary)
        constant = self._constant(live)
        if doc is not None and live:
            live = [ast.Expr(ast.Constant(doc)), *live]
        arguments = [ast.arg(_safe(name)) for name in self.arguments]
        tiles = tuple(t for t in TILES if t in self.tiles)
        node = ast.FunctionDef(
            self.tree.name,
            ast.arguments([], [*(ast.arg(TILES[t]) for t in tiles), *arguments], None, [], [], None, []),
            live, [], None,
        )  # fmt: skip
        return Made(node, tiles, constant, f"{self.function.__module__}.{self.function.__name__}")

    def _constant(self, live: list[ast.stmt]) -> Any:
        if len(live) == 1 and isinstance(live[0], ast.Return) and live[0].value is not None:
            value = live[0].value
            if isinstance(value, _Static):
                return value.known
            if isinstance(value, ast.Constant):
                return Known(value.value)
            if isinstance(value, ast.Name) and value.id in self.arguments:
                return value.id
        return None

    def block(self, statements: list[ast.stmt]) -> list[ast.stmt]:
        found: list[ast.stmt] = []
        for statement in statements:
            found += self.statement(statement)
            if found and isinstance(found[-1], (ast.Return, ast.Break, ast.Continue)):
                break
        return found

    def statement(self, node: ast.stmt) -> list[ast.stmt]:
        method = getattr(self, f"_on_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refused(node, f"the statement '{type(node).__name__}'")
        return method(node)

    def _on_pass(self, node: ast.Pass) -> list[ast.stmt]:
        return []

    def _on_break(self, node: ast.Break) -> list[ast.stmt]:
        return [node]

    _on_continue = _on_break

    def _on_expr(self, node: ast.Expr) -> list[ast.stmt]:
        if isinstance(node.value, ast.Constant):
            return []
        if not isinstance(node.value, ast.Call):
            raise self.refused(node, "an expression that nobody uses")
        value = self.value(node.value)
        return [] if not isinstance(value, ast.expr) else [ast.Expr(value)]

    def _on_return(self, node: ast.Return) -> list[ast.stmt]:
        if node.value is None:
            return [ast.Return(None)]
        value = self.value(node.value)
        if isinstance(value, (Group, Row, Tile)):
            return [ast.Return(_Static(value))]
        return [ast.Return(self.lifted(value, node))]

    def _on_if(self, node: ast.If) -> list[ast.stmt]:
        test = self.value(node.test)
        if isinstance(test, Known):
            return self.block(node.body if test.value else node.orelse)
        before = dict(self.env)
        body = self.block(node.body)
        self.env, after = dict(before), self.env
        orelse = self.block(node.orelse)
        self.env.update({k: v for k, v in after.items() if k not in self.env})
        if not body and not orelse:
            return []
        return [ast.If(self.lifted(test, node), body or [ast.Pass()], orelse)]

    def _on_for(self, node: ast.For) -> list[ast.stmt]:
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise self.refused(node, "a loop over anything but range()")
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise self.refused(node, "a loop of this form")
        bounds = [self.value(a) for a in call.args]
        if bounds == [LANES]:
            self.env[node.target.id] = COLUMN
            return self.block(node.body)
        self.env[node.target.id] = None
        body = self.block(node.body)
        if not body:
            return []
        ends = [self.lifted(b, node) for b in bounds]
        return [ast.For(_name(_safe(node.target.id), ast.Store()), _call("range", ends), body, [])]

    def _on_while(self, node: ast.While) -> list[ast.stmt]:
        test = self.lifted(self.value(node.test), node)
        return [ast.While(test, self.block(node.body), [])]

    def _on_augassign(self, node: ast.AugAssign) -> list[ast.stmt]:
        value = self.lifted(self.value(node.value), node)
        return [ast.AugAssign(self.target(node.target), node.op, value)]

    def _on_assign(self, node: ast.Assign) -> list[ast.stmt]:
        if len(node.targets) == 1 and isinstance(node.targets[0], ast.Tuple):
            return self._unpacked(node.targets[0], node.value, node)
        value = self.value(node.value)
        if len(node.targets) == 1 and self._bound(node.targets[0], value):
            return []
        return [ast.Assign([self.target(t) for t in node.targets], self.lifted(value, node))]

    def _unpacked(self, target: ast.Tuple, given: ast.expr, node: ast.stmt) -> list[ast.stmt]:
        if not isinstance(given, ast.Tuple):
            return [ast.Assign([self.target(target)], self.lifted(self.value(given), node))]
        left, right = [], []
        for one, value in zip(target.elts, [self.value(v) for v in given.elts], strict=True):
            if not self._bound(one, value):
                left.append(one)
                right.append(self.lifted(value, node))
        if not left:
            return []
        targets = [self.target(one) for one in left]
        if len(left) == 1:
            return [ast.Assign(targets, right[0])]
        return [ast.Assign([ast.Tuple(targets, ast.Store())], ast.Tuple(right, ast.Load()))]

    def _bound(self, target: ast.expr, value: Any) -> bool:
        """Keep a name for what is known before the program runs."""
        if not isinstance(target, ast.Name) or isinstance(value, ast.expr):
            return False
        if isinstance(value, Known) and (self.stored.count(target.id) > 1 or isinstance(value.value, float)):
            return False
        self.env[target.id] = value
        return True

    def target(self, node: ast.expr) -> ast.expr:
        if isinstance(node, ast.Name):
            self.env[node.id] = None
            return _name(_safe(node.id), ast.Store())
        if isinstance(node, (ast.Tuple, ast.List)):
            return ast.Tuple([self.target(one) for one in node.elts], ast.Store())
        if isinstance(node, ast.Subscript):
            return self.lifted(self.value(node), node)
        raise self.refused(node, "this target of an assignment")

    # values

    def lifted(self, value: Any, node: ast.AST) -> ast.expr:
        """A value as the program writes it."""
        if isinstance(value, ast.expr):
            return value
        if isinstance(value, Known) and isinstance(value.value, (bool, int, float)):
            if value.name:
                return _name(self.maker.constant(value.name, value.value))
            return ast.Constant(value.value)
        raise self.refused(node, f"{value} as a number")

    def value(self, node: ast.expr) -> Any:
        method = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refused(node, f"the expression '{type(node).__name__}'")
        return method(node)

    def _of__given(self, node: "_Given") -> Any:
        return Known(node.value)

    def _of_constant(self, node: ast.Constant) -> Any:
        return Known(node.value)

    def _of_name(self, node: ast.Name) -> Any:
        if node.id in self.env:
            value = self.env[node.id]
            return _name(_safe(node.id)) if value is None else value
        if node.id in self.stored:
            return _name(_safe(node.id))
        value = self.function.__globals__.get(node.id, getattr(builtins, node.id, None))
        if isinstance(value, (bool, int, float)):
            return Known(value, node.id)
        return Known(value)

    def _of_attribute(self, node: ast.Attribute) -> Any:
        base = self.value(node.value)
        if isinstance(base, Tile) and node.attr in base.lanes:
            _, many, _ = base.lanes._places[node.attr]
            return Row(base.name, node.attr, many)
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
            return self._at(base, [self.value(n) for n in (index.elts if isinstance(index, ast.Tuple) else [index])], node)
        at = self.value(index)
        if isinstance(base, tuple) and isinstance(at, Known):
            return base[at.value]
        if isinstance(base, ast.expr):
            return ast.Subscript(base, self.lifted(at, node), ast.Load())
        raise self.refused(node, "this index")

    def _at(self, row: Row, index: list[Any], node: ast.AST) -> Any:
        self.tiles.add(row.tile)
        place = ast.Attribute(_name(TILES[row.tile]), row.field, ast.Load())
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
        function = _plain(callee.value)
        name = getattr(function, "__name__", "") or getattr(function, "_name", "")
        given = [self.value(a) for a in node.args]
        if isinstance(function, type) and hasattr(function, "_fields"):
            return Group(tuple(zip(function._fields, given, strict=True)))
        if function is _plain(kernels.apart):
            return given[0]
        for known in (*self.maker.elementary, *INTRINSIC):
            if function is _plain(getattr(kernels, known)):
                return _call(known.lstrip("_"), [self.lifted(v, node) for v in given])
        if function in (abs, min, max):
            return _call(name, [self.lifted(v, node) for v in given])
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
            return self._of_call(ast.Call(_Given(kernels.sign), node.args, []))
        raise self.refused(node, f"numpy.{name}")

    def _called(self, function: FunctionType, given: list[Any], node: ast.Call) -> Any:
        bound = inspect.signature(function).bind(*given, **{k.arg or "": self.value(k.value) for k in node.keywords})
        for parameter in inspect.signature(function).parameters.values():
            if parameter.name not in bound.arguments:
                bound.arguments[parameter.name] = Known(parameter.default)
        names = list(inspect.signature(function).parameters)
        stored = {n.id for n in ast.walk(self.maker.source(function)) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        values = [bound.arguments[name] for name in names]
        known = [
            None if isinstance(v, ast.expr) or (isinstance(v, Known) and (isinstance(v.value, float) or n in stored)) else v
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
        return _call(made.node.name, [*(_name(TILES[t]) for t in made.tiles), *passed.values()])


class _Given(ast.expr):
    """A value in the place of an expression."""

    _fields = ()

    def __init__(self, value: Any):
        super().__init__()
        self.value = value


class _Static(ast.expr):
    """What a function gives that is known before the program runs."""

    _fields = ()

    def __init__(self, known: Any):
        super().__init__()
        self.known = known


def _needed(body: list[ast.stmt], elementary: tuple[str, ...]) -> list[ast.stmt]:
    """A function's body without names that are never read, where leaving them out changes nothing else."""
    free = {*elementary, *INTRINSIC, "abs", "min", "max"}
    while True:
        nodes = [n for one in body for n in ast.walk(one)]
        read = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        again = _Needed(read, free)
        body = [kept for one in body if (kept := again.visit(one)) is not None]
        if not again.changed:
            return body


class _Needed(ast.NodeTransformer):
    """One pass of `_needed`."""

    def __init__(self, read: set[str], free: set[str]):
        self.read, self.free, self.changed = read, free, False

    def visit_Assign(self, node: ast.Assign) -> ast.Assign | None:
        target = node.targets[0]
        if len(node.targets) > 1:
            return node
        if not isinstance(target, ast.Tuple) or not isinstance(node.value, ast.Tuple):
            return None if self._idle(target, node.value) else node
        kept = [(t, v) for t, v in zip(target.elts, node.value.elts, strict=True) if not self._idle(t, v)]
        if len(kept) == len(target.elts):
            return node
        if len(kept) < 2:
            return ast.Assign([kept[0][0]], kept[0][1]) if kept else None
        return ast.Assign([ast.Tuple([t for t, _ in kept], ast.Store())], ast.Tuple([v for _, v in kept], ast.Load()))

    def _idle(self, target: ast.expr, value: ast.expr) -> bool:
        calls = [n.func.id for n in ast.walk(value) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
        idle = isinstance(target, ast.Name) and target.id not in self.read and set(calls) <= self.free
        self.changed |= idle
        return idle


def _whole(value: Any) -> bool:
    return isinstance(value, Known) and isinstance(value.value, (bool, int)) 


def _folded(node: ast.expr) -> Any:
    return eval(compile(ast.fix_missing_locations(ast.Expression(node)), "<known>", "eval"))  # two whole numbers


def _safe(name: str) -> str:
    """A local name that is none of a record."""
    return f"{name}_" if name in TILES.values() else name


def _name(name: str, context: ast.expr_context | None = None) -> ast.Name:
    return ast.Name(name, context or ast.Load())


def _call(name: str, arguments: list[ast.expr]) -> ast.Call:
    return ast.Call(_name(name), arguments, [])
