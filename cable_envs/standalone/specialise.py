"""The stages of a plant's kernel as a program of plain functions on numbers, for one mechanism.

The simulator compiles scalar functions that work on columns of tiles (`cable_envs.core.lanes`). Here the same functions
are read from their source, and what is known before they run is left out: the column, which tile an argument is, how
many contacts there are, whether there are effects. What remains is Python of a few constructs on floats, whole numbers,
truth values and the named rows of seven records (`TILES`). `cable_envs.standalone.python_text` prints it, and
`cable_envs.standalone.c_text` translates it. No formula is written here.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Mapping
from types import FunctionType
from typing import Any, cast

from cable_envs.core.lanes import Lanes
from cable_envs.standalone.program import (
    COLUMN,
    ELEMENTARY,
    INTRINSIC,
    LANES,
    NONE,
    TILES,
    TOP,
    Group,
    Known,
    Made,
    NotTranslated,
    Program,
    Row,
    Tile,
)
from cable_envs.standalone.values import Values, call_of, name_of, plain, safe_name


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
    statics: list[Any] = [Tile.of(name, records[name]) for name in ("x", "p", "u", "w")]
    statics += [Tile.of(name, records[name]) if effects else NONE for name in ("e", "s", "g")]
    made = maker.made(plain(solve), [*statics, LANES, None, None])
    made.node.name = TOP
    _rename(maker.finished)
    used = {name: lanes for name, lanes in records.items() if effects or name not in ("e", "s", "g")}
    return Program([*maker.finished], maker.constants, used)


def _rename(functions: list[Made]) -> None:
    """Give functions other names that a function which calls them has for a number."""
    taken, changed = {made.node.name for made in functions}, {}
    calls = {made.node.name: _called_in(made.node) for made in functions}
    for made in functions:
        nodes = list(ast.walk(made.node))
        own = {n.arg for n in nodes if isinstance(n, ast.arg)}
        own |= {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        for name in own & {call.id for call in calls[made.node.name]} & taken:
            changed[name] = f"{name}_of"
    for made in functions:
        for call in calls[made.node.name]:
            call.id = changed.get(call.id, call.id)
    for made in functions:
        made.node.name = changed.get(made.node.name, made.node.name)


def _called_in(text: ast.AST) -> list[ast.Name]:
    return [n.func for n in ast.walk(text) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]


def _is_pure(function: ast.FunctionDef, pure: set[str]) -> bool:
    """Whether a function stores nothing but names of its own, and calls none that does."""
    stored = list[ast.expr]()
    for node in ast.walk(function):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            stored += target.elts if isinstance(target, ast.Tuple) else [target] if target is not None else []
    return all(isinstance(name, ast.Name) for name in stored) and {c.id for c in _called_in(function)} <= pure


class _Maker:
    """Makes each function once for every set of what is known of its arguments."""

    def __init__(self, elementary: tuple[str, ...]):
        self.elementary = elementary
        self.finished: list[Made] = []
        self.pure = {*elementary, *INTRINSIC, *(name.lstrip("_") for name in INTRINSIC), "abs", "min", "max", "range"}
        """names of functions that change no record"""
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
                raise NotTranslated(f"the text of '{function.__name__}' cannot be found; an export needs it") from error
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
                if _is_pure(made.node, self.pure):
                    self.pure.add(made.node.name)
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


class _Body(Values):
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

    def made(self) -> Made:
        body = self.tree.body
        doc = ast.get_docstring(self.tree)
        block = self.block(body[1:] if doc is not None else body)
        live = _needed(block, self.maker.pure)
        constant = self._constant(live)
        if doc is not None and live:
            live = [ast.Expr(ast.Constant(doc)), *live]
        arguments = [ast.arg(safe_name(name)) for name in self.arguments]
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
            if isinstance(value, Static):
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
            return [ast.Return(Static(value))]
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
        return [ast.For(name_of(safe_name(node.target.id), ast.Store()), call_of("range", ends), body, [])]

    def _on_while(self, node: ast.While) -> list[ast.stmt]:
        test = self.lifted(self.value(node.test), node)
        return [ast.While(test, self.block(node.body), [])]

    def _on_augassign(self, node: ast.AugAssign) -> list[ast.stmt]:
        value = self.lifted(self.value(node.value), node)
        return [ast.AugAssign(cast(ast.Name, self.target(node.target)), node.op, value)]

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
            return name_of(safe_name(node.id), ast.Store())
        if isinstance(node, (ast.Tuple, ast.List)):
            return ast.Tuple([self.target(one) for one in node.elts], ast.Store())
        if isinstance(node, ast.Subscript):
            return self.lifted(self.value(node), node)
        raise self.refused(node, "this target of an assignment")


class Static(ast.expr):
    """What a function gives that is known before the program runs."""

    _fields = ()

    def __init__(self, known: Any):
        super().__init__()
        self.known = known


def _needed(body: list[ast.stmt], pure: set[str]) -> list[ast.stmt]:
    """A function's body without names that are never read or are given to themselves, where that changes nothing else.

    pure: names of functions that do nothing but give a number.
    """
    while True:
        nodes = [n for one in body for n in ast.walk(one)]
        read = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        again = _Needed(read, pure)
        body = [kept for one in body if (kept := again.visit(one)) is not None]
        if not again.changed:
            return body


class _Needed(ast.NodeTransformer):
    """One pass of `_needed`."""

    def __init__(self, read: set[str], pure: set[str]):
        self.read, self.pure, self.changed = read, pure, False

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
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        unread = all(isinstance(name, ast.Name) and name.id not in self.read for name in names)
        itself = isinstance(target, ast.Name) and isinstance(value, ast.Name) and target.id == value.id
        idle = itself or (unread and {call.id for call in _called_in(value)} <= self.pure)
        self.changed |= idle
        return idle
