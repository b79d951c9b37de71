"""A program in C99: the functions of `cable_envs.standalone.specialise`, translated statement by statement.

Every operation keeps its place and its order, and the elementary functions are those of the simulator with their fused
multiply-adds, so the numbers are those of the simulator to the bit, with a compiler that fuses nothing by itself
(``-ffp-contract=off``) and reorders nothing (no ``-ffast-math``).
"""

import ast
from collections.abc import Iterator

from cable_envs.standalone.c_values import BINARY, RESERVED, TYPES, Expressions, group, number, place, safe
from cable_envs.standalone.program import TILES, NotTranslated, Program
from cable_envs.standalone.types import BOOL, FLOAT, INT, Kind, Kinds, targets

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
        f"static const double {name} = {number(value)};"
        if isinstance(value, float)
        else f"enum {{ {name} = {value} }};"
        for name, value in program.constants.items()
    ]
    results = sorted({kind for kind in kinds.results.values() if isinstance(kind, tuple)}, key=str)
    several = [f"typedef struct {{ {_members(kind)} }} {group(kind)};" for kind in results]
    return "\n\n".join([PRELUDE + "\n" + "\n".join([*constants, *several]), *bodies]) + "\n"


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


def _members(kind: tuple[Kind, ...]) -> str:
    return " ".join(f"{TYPES[one]} v{k};" for k, one in enumerate(kind))


class _Function(Expressions):
    """One function in C."""

    def text(self) -> str:
        node = self.made.node
        doc = ast.get_docstring(node)
        body = node.body[1:] if doc is not None else node.body
        head = f"static {self.type_of(self.kinds.results[self.name])} {self.names[self.name]}({self.arguments()})"
        lines = self.declarations()
        for statement in body:
            lines += self.statement(statement)
        comment = "" if doc is None else "/* " + doc.replace("*/", "* /").replace("\n", "\n   ").rstrip() + " */\n"
        return comment + head + "\n{\n" + "\n".join(f"    {line}" if line else "" for line in lines) + "\n}"

    def arguments(self) -> str:
        records = [f"{TILES[t]}_t *{TILES[t]}" for t in self.made.tiles]
        own = [f"{self.type_of(self.kinds.local(self.name, a))} {safe(a)}" for a in self.kinds.arguments(self.made)]
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
            yield f"return ({group(kind)}){{{', '.join(values)}}};"
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
        sign = "|" if isinstance(node.op, ast.BitOr) else BINARY[type(node.op)][0]
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
            name = self.temporary(group(kind), self.whole(value))
            yield from self.spread(target, name)
            return
        pairs = [
            (t, v) for t, v in zip(target.elts, value.elts, strict=True)
            if not (isinstance(v, ast.BinOp) and isinstance(v.left, ast.List))
        ]  # fmt: skip
        if self.independent(pairs):
            for one, given in pairs:
                yield from self.statement(ast.Assign([one], given))
            return
        values = []
        for one, given in pairs:
            kind = self.kinds.of(self.name, given)
            values.append((one, self.temporary(self.type_of(kind), self.whole(given))))
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
        places = [{place(t) for t in _leaves(target)} for target, _ in pairs]
        for k, (_, value) in enumerate(pairs):
            if self.impure(value) and len(pairs) > 1:
                return False
            read = {place(n) for n in ast.walk(value) if isinstance(n, (ast.Name, ast.Attribute))}
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
                found.add(place(node))
            elif (
                isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in self.kinds.functions
            ):
                found |= self.reads(node.func.id)
        return found


def _leaves(target: ast.expr) -> list[ast.expr]:
    return [leaf for one in target.elts for leaf in _leaves(one)] if isinstance(target, ast.Tuple) else [target]
