"""A program in C99: the functions of `cable_envs.standalone.specialise`, translated statement by statement.

Every operation keeps its place and its order, and the elementary functions are those of the simulator with their fused
multiply-adds, so the numbers are those of the simulator to the bit, with a compiler that fuses nothing by itself
(``-ffp-contract=off``) and reorders nothing (no ``-ffast-math``).
"""

import ast
import re
from collections.abc import Iterator

from cable_envs.standalone.specialise import TILES, Made, NotTranslated, Program
from cable_envs.standalone.types import BOOL, FLOAT, INT, Kind, Kinds, targets

TYPES = {BOOL: "int", INT: "int64_t", FLOAT: "double"}
_LETTER = {BOOL: "i", INT: "i", FLOAT: "d"}

RESERVED = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while "
    "abs acos asin atan cbrt ceil copysign cos cosh erf exp exp2 expm1 fabs fdim floor fma fmax fmin fmod frexp hypot "
    "ldexp log log10 log1p log2 logb modf nan pow remainder rint round scalbn select signal sin sinh sqrt tan tanh "
    "tgamma trunc index time clock main j0 j1 jn y0 y1 yn gamma signbit".split()
)
"""Words that C, its library or POSIX have for themselves."""

PRELUDE = """\
static inline double select_(int condition, double a, double b) { return condition ? a : b; }
static inline int64_t to_bits(double x) { int64_t n; memcpy(&n, &x, sizeof n); return n; }
static inline double from_bits(int64_t n) { double x; memcpy(&x, &n, sizeof x); return x; }
static inline int64_t shift_right_52(int64_t n) { return (int64_t)((uint64_t)n >> 52); }
static inline int64_t shift_left(int64_t n, int64_t by) { return (int64_t)((uint64_t)n << by); }
static inline double larger(double a, double b) { return b > a ? b : a; }
static inline double smaller(double a, double b) { return b < a ? b : a; }
"""
"""What C lacks."""

_CALLS = {"select": "select_", "abs": "fabs", "max": "larger", "min": "smaller"}
_BINARY = {
    ast.Mult: ("*", 12), ast.Div: ("/", 12), ast.Mod: ("%", 12), ast.Add: ("+", 11), ast.Sub: ("-", 11),
    ast.BitAnd: ("&", 7), ast.BitOr: ("|", 5),
}  # fmt: skip
"""Sign and how closely it binds in C."""
_COMPARED = {
    ast.Lt: ("<", 9), ast.LtE: ("<=", 9), ast.Gt: (">", 9), ast.GtE: (">=", 9), ast.Eq: ("==", 8), ast.NotEq: ("!=", 8),
}  # fmt: skip
_TIGHT, _UNARY, _CHOICE = 20, 14, 2


def functions_in_c(program: Program) -> str:
    """The functions of a program in C, in the order in which they call each other.

    Parameters
    ----------
    program : Program
        Made with no elementary functions left out.

    Returns
    -------
    str
        The prelude, constants, types of several results, and static functions on pointers to the records.

    Raises
    ------
    NotTranslated
        Names the function and the construct that there is no translation for.
    """
    kinds = Kinds(program)
    names = _function_names(kinds)
    bodies = [_Function(made, kinds, names).text() for made in program.functions]
    constants = [
        f"static const double {name} = {number(value)};" if isinstance(value, float) else f"enum {{ {name} = {value} }};"
        for name, value in program.constants.items()
    ]
    results = sorted({kind for kind in kinds.results.values() if isinstance(kind, tuple)}, key=str)
    several = [f"typedef struct {{ {_members(kind)} }} {_group(kind)};" for kind in results]
    return "\n\n".join([PRELUDE + "\n" + "\n".join([*constants, *several]), *bodies]) + "\n"


def number(value: float) -> str:
    """A float as C reads it back to the bit."""
    if value != value or value in (float("inf"), float("-inf")):
        return {"inf": "INFINITY", "-inf": "-INFINITY"}.get(repr(value), "NAN")
    return repr(float(value))


def _function_names(kinds: Kinds) -> dict[str, str]:
    local = {name for names in kinds.names.values() for name in names}
    taken = RESERVED | local | set(TILES.values()) | set(kinds.program.constants)
    names: dict[str, str] = {}
    for function in kinds.functions:
        name = function.strip("_")
        while name in taken:
            name = f"{name}_"
        names[function] = name
        taken |= {name}
    return names


def _group(kind: tuple[Kind, ...]) -> str:
    return "several_" + "".join(_LETTER[one] for one in kind)


def _members(kind: tuple[Kind, ...]) -> str:
    return " ".join(f"{TYPES[one]} v{k};" for k, one in enumerate(kind))


class _Function:
    """One function in C."""

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
        return NotTranslated(f"{self.made.origin}: {what} cannot be written in C: {ast.unparse(node)}")

    def text(self) -> str:
        node = self.made.node
        doc = ast.get_docstring(node)
        body = node.body[1:] if doc is not None else node.body
        head = f"static {self.type(self.kinds.results[self.name])} {self.names[self.name]}({self.arguments()})"
        lines = self.declarations()
        for statement in body:
            lines += self.statement(statement)
        comment = "" if doc is None else "/* " + doc.replace("*/", "* /").replace("\n", "\n   ").rstrip() + " */\n"
        return comment + head + "\n{\n" + "\n".join(f"    {line}" if line else "" for line in lines) + "\n}"

    def type(self, kind: Kind) -> str:
        if kind is None:
            return "void"
        return _group(kind) if isinstance(kind, tuple) else TYPES[kind]

    def arguments(self) -> str:
        records = [f"{TILES[t]}_t *{TILES[t]}" for t in self.made.tiles]
        own = [f"{self.type(self.kinds.local(self.name, a))} {safe(a)}" for a in self.kinds.arguments(self.made)]
        return ", ".join([*records, *own]) or "void"

    def declarations(self) -> list[str]:
        given = set(self.kinds.arguments(self.made))
        stored = {t.id for t in targets(self.made.node) if isinstance(t, ast.Name)} - given
        stored = {name for name in stored if name in self.read or name in self.counted}
        lines = []
        for kind in (FLOAT, INT, BOOL):
            of_kind = sorted(safe(n) for n in stored if self.kinds.local(self.name, n) == kind)
            if of_kind:
                lines.append(f"{TYPES[kind]} {', '.join(of_kind)};")
        for name in sorted(stored):
            kind = self.kinds.local(self.name, name)
            if isinstance(kind, tuple) and kind[:1] == ("array",):
                lines.append(f"double {safe(name)}[{kind[1]}] = {{0.0}};")
            elif kind is None or isinstance(kind, tuple):
                raise NotTranslated(f"{self.made.origin}: '{name}' is no number, which C would need")
        return lines

    # statements

    def statement(self, node: ast.stmt) -> list[str]:
        method = getattr(self, f"_on_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.refused(node, "this statement")
        outer, self.before = self.before, []
        lines = list(method(node))
        lines, self.before = [*self.before, *lines], outer
        return lines

    def block(self, statements: list[ast.stmt]) -> list[str]:
        return [f"    {line}" for one in statements for line in self.statement(one)]

    def _on_pass(self, node: ast.Pass) -> Iterator[str]:
        yield ";"

    def _on_break(self, node: ast.Break) -> Iterator[str]:
        yield "break;"

    def _on_continue(self, node: ast.Continue) -> Iterator[str]:
        yield "continue;"

    def _on_expr(self, node: ast.Expr) -> Iterator[str]:
        yield f"{self.whole(node.value)};"

    def _on_return(self, node: ast.Return) -> Iterator[str]:
        if node.value is None:
            yield "return;"
        elif isinstance(node.value, ast.Tuple):
            kind = self.kinds.results[self.name]
            values = self.in_order(node.value.elts)
            yield f"return ({_group(kind)}){{{', '.join(values)}}};"
        else:
            yield f"return {self.whole(node.value)};"

    def _on_if(self, node: ast.If) -> Iterator[str]:
        yield f"if ({self.expression(node.test)}) {{"
        yield from self.block(node.body)
        if node.orelse:
            yield "} else {"
            yield from self.block(node.orelse)
        yield "}"

    def _on_while(self, node: ast.While) -> Iterator[str]:
        self.conditional += 1
        yield f"while ({self.expression(node.test)}) {{"
        self.conditional -= 1
        yield from self.block(node.body)
        yield "}"

    def _on_for(self, node: ast.For) -> Iterator[str]:
        if not (isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name) and len(node.iter.args) < 3):
            raise self.refused(node, "this loop")
        ends = [self.expression(a, 10) for a in node.iter.args]
        first, last = ends if len(ends) == 2 else ("0", ends[0])
        k = safe(node.target.id)
        yield f"for ({k} = {first}; {k} < {last}; {k}++) {{"
        yield from self.block(node.body)
        yield "}"

    def _on_augassign(self, node: ast.AugAssign) -> Iterator[str]:
        sign = "|" if isinstance(node.op, ast.BitOr) else _BINARY[type(node.op)][0]
        yield f"{self.expression(node.target)} {sign}= {self.whole(node.value)};"

    def _on_assign(self, node: ast.Assign) -> Iterator[str]:
        first = node.targets[0]
        if isinstance(node.value, ast.BinOp) and isinstance(node.value.left, ast.List):
            return  # declared with zeros
        if isinstance(first, ast.Tuple):
            yield from self.unpacked(first, node.value)
        else:
            places = " = ".join(self.expression(t) for t in reversed(node.targets))
            yield f"{places} = {self.whole(node.value)};"

    def unpacked(self, target: ast.Tuple, value: ast.expr) -> Iterator[str]:
        if not isinstance(value, ast.Tuple):
            kind = self.kinds.of(self.name, value)
            name = self.temporary(_group(kind), self.whole(value))
            yield from self.spread(target, name)
            return
        pairs = [
            (t, v) for t, v in zip(target.elts, value.elts, strict=True)
            if not (isinstance(v, ast.BinOp) and isinstance(v.left, ast.List))
        ]  # fmt: skip
        if self.independent(pairs):
            for one, given in pairs:
                for line in self.statement(ast.Assign([one], given)):
                    yield line
            return
        values = []
        for one, given in pairs:
            kind = self.kinds.of(self.name, given)
            values.append((one, self.temporary(self.type(kind), self.whole(given))))
        for one, name in values:
            if isinstance(one, ast.Tuple):
                yield from self.spread(one, name)
            else:
                yield f"{self.expression(one)} = {name};"

    def spread(self, target: ast.Tuple, name: str) -> Iterator[str]:
        for k, one in enumerate(target.elts):
            if not (isinstance(one, ast.Name) and one.id not in self.read):
                yield f"{self.expression(one)} = {name}.v{k};"

    def independent(self, pairs: list[tuple[ast.expr, ast.expr]]) -> bool:
        """Whether values may be assigned one after the other: none reads, or changes, what another one assigns."""
        places = [{_place(t) for t in _leaves(target)} for target, _ in pairs]
        for k, (_, value) in enumerate(pairs):
            if self.impure(value) and len(pairs) > 1:
                return False
            read = {_place(n) for n in ast.walk(value) if isinstance(n, (ast.Name, ast.Attribute))}
            for called in (n for n in ast.walk(value) if isinstance(n, ast.Call)):
                if isinstance(called.func, ast.Name) and called.func.id in self.kinds.functions:
                    read |= self.reads(called.func.id)
            if any(read & before for before in places[:k]):
                return False
        return True

    def reads(self, function: str) -> set[str]:
        """Fields that a function, or what it calls, looks at."""
        found = set()
        for node in ast.walk(self.kinds.functions[function].node):
            if isinstance(node, ast.Attribute):
                found.add(_place(node))
            elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.kinds.functions:
                found |= self.reads(node.func.id)
        return found

    def impure(self, node: ast.AST) -> bool:
        return any(
            isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and self.kinds.writes.get(n.func.id)
            for n in ast.walk(node)
        )

    def temporary(self, kind: str, value: str) -> str:
        self.temporaries += 1
        name = f"t{self.temporaries}_"
        self.before.append(f"const {kind} {name} = {value};")
        return name

    # expressions

    def in_order(self, nodes: list[ast.expr]) -> list[str]:
        """Values that stand beside each other; those of functions that change something first, in their order."""
        if sum(self.impure(n) for n in nodes) == 0:
            return [self.expression(n) for n in nodes]
        return [
            self.temporary(self.type(self.kinds.of(self.name, n)), self.whole(n)) if self.impure(n) else self.expression(n)
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
        read = {_place(n) for n in ast.walk(node) if isinstance(n, ast.Attribute)}
        if changed & read:
            raise self.refused(node, "an expression that reads what a call in it changes")

    def expression(self, node: ast.expr, binds: int = 0) -> str:
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
        if type(node.op) not in _BINARY:
            raise self.refused(node, "this operator")
        sign, own = _BINARY[type(node.op)]
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
            return self.temporary(self.type(self.kinds.results[name]), text), _TIGHT
        return text, _TIGHT


def safe(name: str) -> str:
    """A name that C does not have for itself."""
    return f"{name}_" if name in RESERVED else name


def _place(node: ast.AST) -> str:
    return re.sub(r"\[.*", "", ast.unparse(node))


def _leaves(target: ast.expr) -> list[ast.expr]:
    return [leaf for one in target.elts for leaf in _leaves(one)] if isinstance(target, ast.Tuple) else [target]
