"""The expressions of a program in C99."""

import ast
import re

from cable_envs.standalone.program import Made, NotTranslated
from cable_envs.standalone.types import BOOL, FLOAT, INT, Kind, Kinds

TYPES = {BOOL: "int", INT: "int64_t", FLOAT: "double"}
_LETTER = {BOOL: "i", INT: "i", FLOAT: "d"}

_WORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
abs acos asin atan cbrt ceil copysign cos cosh erf exp exp2 expm1 fabs fdim floor fma fmax fmin fmod frexp hypot
ldexp log log10 log1p log2 logb modf nan pow remainder rint round scalbn select signal sin sinh sqrt tan tanh
tgamma trunc index time clock main j0 j1 jn y0 y1 yn gamma signbit
"""
RESERVED = frozenset(_WORDS.split())
"""Words that C, its library or POSIX have for themselves."""

_CALLS = {"select": "select_", "abs": "fabs", "max": "larger", "min": "smaller"}
BINARY = {
    ast.Mult: ("*", 12), ast.Div: ("/", 12), ast.Mod: ("%", 12), ast.Add: ("+", 11), ast.Sub: ("-", 11),
    ast.BitAnd: ("&", 7), ast.BitOr: ("|", 5),
}  # fmt: skip
"""Sign and how closely it binds in C."""
_COMPARED = {
    ast.Lt: ("<", 9), ast.LtE: ("<=", 9), ast.Gt: (">", 9), ast.GtE: (">=", 9), ast.Eq: ("==", 8), ast.NotEq: ("!=", 8),
}  # fmt: skip
_TIGHT, _UNARY, _CHOICE = 20, 14, 2


class Expressions:
    """Expressions of one function in C.

    Parameters
    ----------
    made : Made
        The function.
    kinds : Kinds
        Of the program.
    names : dict of str to str
        Function of the program -> its name in C.
    """

    def __init__(self, made: Made, kinds: Kinds, names: dict[str, str]):
        self.made, self.kinds, self.names = made, kinds, names
        self.name = made.node.name
        self.before: list[str] = []
        self.temporaries = 0
        nodes = list(ast.walk(made.node))
        self.read = {n.id for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Load)}
        self.counted = {n.target.id for n in nodes if isinstance(n, ast.For) and isinstance(n.target, ast.Name)}
        self.conditional = 0

    def refused(self, node: ast.AST, what: str) -> NotTranslated:
        """The error for a construct, with its function."""
        return NotTranslated(f"{self.made.origin}: {what} cannot be written in C: {ast.unparse(node)}")

    def type_of(self, kind: Kind) -> str:
        """The type in C of values of a kind."""
        if kind is None:
            return "void"
        return group(kind) if isinstance(kind, tuple) else TYPES[kind]

    def impure(self, node: ast.AST) -> bool:
        """Whether something is called in it that changes a record."""
        return any(
            isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and self.kinds.writes.get(n.func.id)
            for n in ast.walk(node)
        )

    def temporary(self, kind: str, value: str) -> str:
        """The name of a value that is computed before the present statement."""
        self.temporaries += 1
        name = f"t{self.temporaries}_"
        self.before.append(f"const {kind} {name} = {value};")
        return name

    def in_order(self, nodes: list[ast.expr]) -> list[str]:
        """Values that stand beside each other; those of functions that change something first, in their order."""
        if sum(self.impure(n) for n in nodes) == 0:
            return [self.expression(n) for n in nodes]
        return [
            self.temporary(self.type_of(self.kinds.of(self.name, n)), self.whole(n))
            if self.impure(n)
            else self.expression(n)
            for n in nodes
        ]

    def whole(self, node: ast.expr) -> str:
        """An expression that is a statement's only one: a call that changes something may stand at its top."""
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.kinds.functions:
            return f"{self.names[node.func.id]}({', '.join(self.in_order(node.args))})"
        self.require_order(node)
        return self.expression(node)

    def require_order(self, node: ast.expr) -> None:
        """Refuse an expression that reads what a function called within it changes: C has no order for that."""
        changed: set[str] = set()
        for call in (n for n in ast.walk(node) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)):
            changed |= self.kinds.writes.get(call.func.id, set())  # type: ignore[attr-defined]
        read = {place(n) for n in ast.walk(node) if isinstance(n, ast.Attribute)}
        if changed & read:
            raise self.refused(node, "an expression that reads what a call in it changes")

    def expression(self, node: ast.expr, binds: int = 0) -> str:
        """An expression, in parentheses where what is around it binds more closely."""
        method = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refused(node, "this expression")
        text, own = method(node)
        return text if own >= binds else f"({text})"

    def _of_constant(self, node: ast.Constant) -> tuple[str, int]:
        if isinstance(node.value, bool):
            return str(int(node.value)), _TIGHT
        if isinstance(node.value, int):
            return (str(node.value) if abs(node.value) < 2**31 else f"INT64_C({node.value})"), _TIGHT
        if isinstance(node.value, float):
            text = number(node.value)
            return text, _UNARY if text.startswith("-") else _TIGHT
        raise self.refused(node, "this constant")

    def _of_name(self, node: ast.Name) -> tuple[str, int]:
        own = node.id in self.kinds.program.constants and node.id not in self.kinds.names[self.name]
        return node.id if own else safe(node.id), _TIGHT

    def _of_attribute(self, node: ast.Attribute) -> tuple[str, int]:
        if not isinstance(node.value, ast.Name):
            raise self.refused(node, "this name")
        return f"{node.value.id}->{safe(node.attr)}", _TIGHT

    def _of_subscript(self, node: ast.Subscript) -> tuple[str, int]:
        if isinstance(self.kinds.of(self.name, node.value), tuple) and isinstance(node.value, ast.Call):
            return f"{self.expression(node.value, _TIGHT)}.v{ast.unparse(node.slice)}", _TIGHT
        return f"{self.expression(node.value, _TIGHT)}[{self.expression(node.slice)}]", _TIGHT

    def _of_binop(self, node: ast.BinOp) -> tuple[str, int]:
        if isinstance(node.op, ast.LShift):
            return f"shift_left({self.expression(node.left)}, {self.expression(node.right)})", _TIGHT
        if type(node.op) not in BINARY:
            raise self.refused(node, "this operator")
        sign, own = BINARY[type(node.op)]
        left, right = self.expression(node.left, own), self.expression(node.right, own + 1)
        whole = {self.kinds.of(self.name, n) for n in (node.left, node.right)} <= {BOOL, INT}
        if isinstance(node.op, ast.Div) and whole:
            left = f"(double){self.expression(node.left, _UNARY)}"
        if isinstance(node.op, (ast.BitAnd, ast.BitOr)):  # compilers ask for the parentheses
            left, right = self.expression(node.left, _TIGHT), self.expression(node.right, _TIGHT)
        return f"{left} {sign} {right}", own

    def _of_unaryop(self, node: ast.UnaryOp) -> tuple[str, int]:
        if isinstance(node.op, ast.Not):
            return f"!{self.expression(node.operand, _UNARY + 1)}", _UNARY
        if isinstance(node.op, ast.USub):
            return f"-{self.expression(node.operand, _UNARY + 1)}", _UNARY
        raise self.refused(node, "this operator")

    def _of_compare(self, node: ast.Compare) -> tuple[str, int]:
        if len(node.ops) > 1 or type(node.ops[0]) not in _COMPARED:
            raise self.refused(node, "this comparison")
        sign, own = _COMPARED[type(node.ops[0])]
        return f"{self.expression(node.left, own + 1)} {sign} {self.expression(node.comparators[0], own + 1)}", own

    def _of_boolop(self, node: ast.BoolOp) -> tuple[str, int]:
        either = isinstance(node.op, ast.Or)
        first = self.expression(node.values[0], _TIGHT)
        self.conditional += 1
        others = [self.expression(n, _TIGHT) for n in node.values[1:]]
        self.conditional -= 1
        if self.kinds.of(self.name, node) == BOOL or len(others) > 1:
            sign, own = ("||", 3) if either else ("&&", 4)
            return f" {sign} ".join([first, *others]), own
        return (f"{first} ? {first} : {others[0]}" if either else f"{first} ? {others[0]} : {first}"), _CHOICE

    def _of_ifexp(self, node: ast.IfExp) -> tuple[str, int]:
        test = self.expression(node.test, _CHOICE + 1)
        self.conditional += 1
        text = f"{test} ? {self.expression(node.body, _CHOICE + 1)} : {self.expression(node.orelse, _CHOICE)}"
        self.conditional -= 1
        return text, _CHOICE

    def _of_call(self, node: ast.Call) -> tuple[str, int]:
        if not isinstance(node.func, ast.Name):
            raise self.refused(node, "this call")
        name = node.func.id
        arguments = [self.expression(a) for a in node.args]
        text = f"{self.names.get(name) or _CALLS.get(name, name)}({', '.join(arguments)})"
        if self.kinds.writes.get(name):
            if self.conditional:
                raise self.refused(node, "a call that changes something under a condition")
            return self.temporary(self.type_of(self.kinds.results[name]), text), _TIGHT
        return text, _TIGHT


def group(kind: tuple[Kind, ...]) -> str:
    """Name of the type of several results."""
    return "several_" + "".join(_LETTER[one] for one in kind)


def number(value: float) -> str:
    """A float as C reads it back to the bit."""
    if value != value or value in (float("inf"), float("-inf")):
        return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(repr(value), "NAN")
    return repr(float(value))


def safe(name: str) -> str:
    """A name that C does not have for itself."""
    return f"{name}_" if name in RESERVED else name


def place(node: ast.AST) -> str:
    """A name or field without what is between brackets."""
    return re.sub(r"\[.*", "", ast.unparse(node))
