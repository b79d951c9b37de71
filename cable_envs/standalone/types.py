"""What kind of value every name and expression of a program has, for languages that declare it."""

import ast
from typing import Any

from cable_envs.standalone.program import TILES, TOP, Made, NotTranslated, Program

BOOL, INT, FLOAT = "bool", "int", "float"
"""Kinds of numbers, each of which holds those before it."""

Kind = Any
"""One of these; a tuple of kinds; ("array", length); or None where nothing is known yet, or nothing is given."""

_ORDER = (BOOL, INT, FLOAT)
_GIVEN: dict[str, Kind] = {
    "select": FLOAT, "sqrt": FLOAT, "fma": FLOAT, "to_bits": INT, "from_bits": FLOAT, "shift_right_52": INT,
    "abs": FLOAT,
}  # fmt: skip


def joined(a: Kind, b: Kind) -> Kind:
    """The kind that holds both."""
    if a is None or b is None or a == b:
        return b if a is None else a
    if isinstance(a, tuple) and isinstance(b, tuple) and len(a) == len(b):
        return tuple(joined(x, y) for x, y in zip(a, b, strict=True))
    if a in _ORDER and b in _ORDER:
        return max(a, b, key=_ORDER.index)
    raise NotTranslated(f"one name stands for two kinds of values: {a} and {b}")


class Kinds:
    """Kinds of arguments, names and results of every function of a program.

    Parameters
    ----------
    program : Program
        The program.

    Attributes
    ----------
    names : dict of str to dict
        Function -> kinds of its arguments and local names.
    results : dict of str to kind
        Function -> what it gives.
    writes : dict of str to set
        Function -> fields of records, as "signals.force", that it or what it calls changes.
    """

    def __init__(self, program: Program):
        self.program = program
        self.functions = {made.node.name: made for made in program.functions}
        self.names: dict[str, dict[str, Kind]] = {name: {} for name in self.functions}
        self.results: dict[str, Kind] = dict.fromkeys(self.functions)
        self.names[TOP] |= {"substeps": INT, "dt": FLOAT}
        self._changed = True
        while self._changed:
            self._changed = False
            for made in reversed(program.functions):
                for node in ast.walk(made.node):
                    self._statement(made, node)
        self.writes: dict[str, set[str]] = {}
        for made in program.functions:
            self.writes[made.node.name] = self._written(made)

    def local(self, function: str, name: str) -> Kind:
        """The kind of an argument or local name."""
        return self.names[function].get(name)

    def arguments(self, made: Made) -> list[str]:
        """Names of its arguments that are no records."""
        return [a.arg for a in made.node.args.args][len(made.tiles) :]

    def of(self, function: str, node: ast.expr) -> Kind:
        """The kind of an expression in a function."""
        if isinstance(node, ast.Constant):
            return {bool: BOOL, int: INT, float: FLOAT}[type(node.value)]
        if isinstance(node, ast.Name):
            return self._of_name(function, node.id)
        if isinstance(node, ast.Attribute):
            return FLOAT
        if isinstance(node, (ast.Compare, ast.BoolOp)) or (
            isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
        ):
            return self._of_condition(function, node)
        if isinstance(node, ast.Tuple):
            return tuple(self.of(function, one) for one in node.elts)
        return self._of_other(function, node)

    def _of_name(self, function: str, name: str) -> Kind:
        constant = self.program.constants.get(name)
        if name not in self.names[function] and constant is not None:
            return FLOAT if isinstance(constant, float) else INT
        return self.local(function, name)

    def _of_condition(self, function: str, node: ast.expr) -> Kind:
        found: Kind = BOOL
        for one in node.values if isinstance(node, ast.BoolOp) else []:
            found = joined(found, self.of(function, one))
        return found

    def _of_other(self, function: str, node: ast.expr) -> Kind:
        if isinstance(node, ast.Subscript):
            base = self.of(function, node.value)
            whole = isinstance(base, tuple) and base[:1] != ("array",) and isinstance(node.slice, ast.Constant)
            return base[node.slice.value] if whole else FLOAT  # type: ignore[attr-defined]
        if isinstance(node, ast.BinOp):
            return self._of_binary(function, node)
        if isinstance(node, ast.UnaryOp):
            return self.of(function, node.operand)
        if isinstance(node, ast.IfExp):
            return joined(self.of(function, node.body), self.of(function, node.orelse))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            return self._of_call(function, node.func.id, node)
        raise NotTranslated(f"{function}: '{ast.unparse(node)}' has no kind")

    def _of_binary(self, function: str, node: ast.BinOp) -> Kind:
        if isinstance(node.left, ast.List):
            return ("array", ast.unparse(node.right))
        if isinstance(node.op, ast.Div):
            return FLOAT
        both = joined(self.of(function, node.left), self.of(function, node.right))
        logic = isinstance(node.op, (ast.BitAnd, ast.BitOr))
        return both if both != BOOL or logic else INT

    def _of_call(self, function: str, name: str, node: ast.Call) -> Kind:
        if name in self.functions:
            return self.results[name]
        if name in ("min", "max"):
            return joined(self.of(function, node.args[0]), self.of(function, node.args[1]))
        if name in _GIVEN:
            return _GIVEN[name]
        raise NotTranslated(f"{function}: nothing is known of '{name}'")

    def _statement(self, made: Made, node: ast.AST) -> None:
        function = made.node.name
        if isinstance(node, ast.Assign):
            kind = self.of(function, node.value)
            for target in node.targets:
                self._assigned(function, target, kind)
        elif isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
            kind = self.of(function, ast.BinOp(ast.Name(node.target.id, ast.Load()), node.op, node.value))
            self._assigned(function, node.target, kind)
        elif isinstance(node, ast.For):
            self._assigned(function, node.target, INT)
        elif isinstance(node, ast.Return) and node.value is not None:
            kind = joined(self.results[function], self.of(function, node.value))
            self._changed |= kind != self.results[function]
            self.results[function] = kind
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.functions:
            callee = self.functions[node.func.id]
            given = node.args[len(callee.tiles) :]
            for name, value in zip(self.arguments(callee), given, strict=True):
                self._noted(node.func.id, name, self.of(function, value))

    def _assigned(self, function: str, target: ast.expr, kind: Kind) -> None:
        if isinstance(target, ast.Name):
            self._noted(function, target.id, kind)
        elif isinstance(target, ast.Tuple) and isinstance(kind, tuple):
            for one, own in zip(target.elts, kind, strict=True):
                self._assigned(function, one, own)

    def _noted(self, function: str, name: str, kind: Kind) -> None:
        old = self.names[function].get(name)
        new = joined(old, kind)
        self._changed |= new != old
        self.names[function][name] = new

    def _written(self, made: Made) -> set[str]:
        found = {
            ast.unparse(n) for n in ast.walk(made.node) if isinstance(n, ast.Attribute) and _is_target(made.node, n)
        }
        for node in ast.walk(made.node):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                found |= self.writes.get(node.func.id, set())
        return found


def _is_target(function: ast.FunctionDef, place: ast.Attribute) -> bool:
    return any(place is one for one in targets(function))


def targets(function: ast.FunctionDef) -> list[ast.expr]:
    """Everything that a function assigns to; of an element of a sequence the sequence."""
    waiting: list[ast.expr] = []
    for node in ast.walk(function):
        if isinstance(node, ast.Assign):
            waiting += node.targets
        elif isinstance(node, (ast.AugAssign, ast.For)):
            waiting.append(node.target)
    found: list[ast.expr] = []
    while waiting:
        one = waiting.pop()
        if isinstance(one, ast.Tuple):
            waiting += one.elts
        else:
            found.append(one.value if isinstance(one, ast.Subscript) else one)
    return found


def fields_used(program: Program) -> dict[str, list[str]]:
    """Fields of each record that a program reads or writes, in the order of the record."""
    found: dict[str, set[str]] = {name: set() for name in TILES.values()}
    for made in program.functions:
        for node in ast.walk(made.node):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                found[node.value.id].add(node.attr)
    return {TILES[t]: [f for f in lanes.names if f in found[TILES[t]]] for t, lanes in program.records.items()}
