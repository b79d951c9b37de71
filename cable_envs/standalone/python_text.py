"""A rig as one Python file that needs nothing but `math`."""

import ast
import textwrap
from collections.abc import Mapping
from typing import Any

from cable_envs.core.inputs import INPUTS
from cable_envs.effects.base import lane_of
from cable_envs.standalone.law import Law
from cable_envs.standalone.program import TILES, TOP, Made, Program
from cable_envs.standalone.types import fields_used

PRELUDE = '''
class Record:
    """Named numbers, and lists of numbers."""

    def __init__(self, **fields):
        self.__dict__.update(fields)

    def copy(self):
        """The same numbers, which may then be changed."""
        return Record(**{name: list(v) if isinstance(v, list) else v for name, v in self.__dict__.items()})


def select(condition, a, b):
    """a where the condition holds, else b."""
    return a if condition else b


def minimum(a, b):
    """The smaller of two numbers; one that is not a number is passed on from a."""
    return b if b < a else a


def maximum(a, b):
    """The larger of two numbers; one that is not a number is passed on from a."""
    return b if b > a else a


def clip(x, low, high):
    """x limited to [low, high]."""
    return minimum(maximum(x, low), high)


def sign(x):
    """-1.0, 0.0 or 1.0."""
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0


def sqrt(x):
    """Square root; not a number below 0."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def fma(a, b, c):
    """a b + c, rounded once; older versions of Python have no function for it."""
    if hasattr(math, "fma"):
        return math.fma(a, b, c)
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        return a * b + c
    (i, j), (k, l), (m, n) = a.as_integer_ratio(), b.as_integer_ratio(), c.as_integer_ratio()
    above = i * k * n + m * j * l
    return above / (j * l * n) if above else a * b + c


def to_bits(x):
    """The 64 bits of a number, as a whole number with a sign."""
    size = abs(x)
    if size != size or size == math.inf:
        bits = 0x7FF8 << 48 if size != size else 0x7FF << 52
    elif size < 2.0**-1022:
        bits = int(math.ldexp(size, 1074))
    else:
        share, power = math.frexp(size)
        bits = ((power + 1021) << 52) + int(math.ldexp(share, 53))
    return bits if math.copysign(1.0, x) > 0.0 else bits - (1 << 63)


def from_bits(n):
    """The number of 64 bits."""
    power, share = (n >> 52) & 0x7FF, n & ((1 << 52) - 1)
    if power == 0x7FF:
        size = math.nan if share else math.inf
    else:
        size = math.ldexp(share + (1 << 52 if power else 0), max(power, 1) - 1075)
    return -size if (n >> 63) & 1 else size


def shift_right_52(n):
    """The bits of sign and exponent."""
    return (n & ((1 << 64) - 1)) >> 52


def quotient(a, b):
    """a / b, infinite or not a number where b is 0: it stands where a choice then takes another value."""
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)
'''


def python_text(law: Law) -> str:
    """A rig in Python.

    Parameters
    ----------
    law : Law
        The rig.

    Returns
    -------
    str
        Text of a file that defines a class ``Rig``.
    """
    program = law.program()
    used = fields_used(program)
    constants, named = _parameters(law)
    parts = [
        _head(law),
        "import math",
        "# Parameters of the rig, SI\n" + "\n".join(constants),
        f"PERIOD = {law.period!r}  # s: control step\nSUBSTEPS = {law.substeps}  # integration steps in it",
        *(["# Constants of the numerical method\n" + "\n".join(f"{n} = {v!r}" for n, v in program.constants.items())]
          if program.constants else []),
        "SIGNALS = {  # what the rig shows: unit and meaning\n"
        + "\n".join(f"    {e.name!r}: ({e.unit!r}, {e.meaning!r})," for e in law.outputs) + "\n}",
        PRELUDE.strip("\n"),
        *(_function(made, law) for made in program.functions),
        _coefficients(law, program, used, named),
        *([_sensors(law)] if law.sensors else []),
        _rig(law, program, used),
    ]  # fmt: skip
    return "\n\n\n".join(parts) + "\n"


def _head(law: Law) -> str:
    first = law.inputs[0]
    shown = next(iter(law.places))
    ranges = [f"{name} in [{low:g}, {high:g}]" for name, (low, high) in law.rig.holds(law.plant).items()]
    holds = f"The parameters hold for {', '.join(ranges)} (SI).\n\n" if ranges else ""
    told = f"{first.name}, {first.unit}: {first.meaning}"
    rate = ", 0.0" if law.follows else ""
    about = textwrap.fill(f"{law.rig.name}: {law.rig.description or law.plant.name}", 116)
    quoted = about.replace("\\", "\\\\").replace('"""', "'''")
    return (
        f'"""{quoted}\n\nWritten by `cablebench export-rig`. All numbers are SI.\n\n'
        f"    from {law.name} import Rig\n\n    rig = Rig()  # at rest with the output at {law.start:g}\n"
        f"    rig.step(0.0{rate})  # {told}\n    print(rig.signals.{shown})\n\n{holds}"
        "The functions are those of the simulator, for one mechanism: what does not concern it is left out. The\n"
        "records RIG and EFFECTS hold what they compute with. Where a number there is no named parameter, it was\n"
        "derived from several of them when this file was written: to change a parameter, change the rig and export\n"
        'it again.\n"""'
    )


def _parameters(law: Law) -> tuple[list[str], dict[str, tuple[str, float]]]:
    """Lines of the named parameters; field of RIG or EFFECTS -> (name of the constant, value)."""
    lines, named = [], {}
    effects = law.plant.effects.effects
    for name, value, unit, meaning in law.parameters:
        constant = name.replace(".", "_").upper()
        lines.append(f"{constant} = {value!r}  # {unit}: {meaning}")
        effect, _, parameter = name.rpartition(".")
        known = [p for p in effects[effect].parameters if p.name == parameter] if effect else []
        named[lane_of(effects[effect], known[0]) if known else name] = constant, value
    return lines, named


def _function(made: Made, law: Law) -> str:
    node = _Quotients(law).visit(ast.parse(ast.unparse(ast.fix_missing_locations(made.node))).body[0])
    doc = ast.get_docstring(node)
    body = node.body[1:] if doc is not None else node.body
    head = f"def {node.name}({', '.join(a.arg for a in node.args.args)}):"
    lines = [head]
    if doc is not None:
        text = doc.split("\nExamples\n")[0].rstrip().replace("\\", "\\\\")
        lines.append(textwrap.indent(f'"""{text}' + ('\n"""' if "\n" in text else '"""'), "    "))
    lines += [textwrap.indent(ast.unparse(ast.fix_missing_locations(one)), "    ") for one in body]
    return "\n".join(lines)


class _Quotients(ast.NodeTransformer):
    """Puts `quotient` in the place of quotients whose divisor may be 0."""

    def __init__(self, law: Law):
        self.values = law.values

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.op, ast.Div) and not self._sure(node.right):
            return ast.Call(ast.Name("quotient", ast.Load()), [node.left, node.right], [])
        return node

    def _sure(self, node: ast.expr) -> bool:
        """Whether a divisor is never 0."""
        if isinstance(node, ast.Constant):
            return bool(node.value)
        if isinstance(node, ast.Name):
            return node.id in ("dt", "substeps")
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "rig":
            return self.values["rig"][node.attr] != 0.0
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
            return self._sure(node.left) and self._sure(node.right)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "maximum":
            return any(isinstance(a, ast.Constant) and isinstance(a.value, float) and a.value > 0.0 for a in node.args)
        return False


def _coefficients(
    law: Law, program: Program, used: Mapping[str, list[str]], named: Mapping[str, tuple[str, float]]
) -> str:
    parts = []
    for record in ("rig", "effects"):
        if not used.get(record):
            continue
        lines = []
        for field in used[record]:
            value = law.values[record][field]
            name, given = named.get(field, ("", None))
            lines.append(f"    {field}={name if name and given == value else repr(value)},")
        parts.append(f"{record.upper()} = Record(\n" + "\n".join(lines) + "\n)")
    return "\n".join(parts)


def _sensors(law: Law) -> str:
    lines = [f"    {s.signal!r}: ({s.scale!r}, {s.bias!r}, {s.cut!r}, {s.late!r})," for s in law.sensors]
    return (
        "SENSORS = {  # those that have an effect: scale, bias, share of what is negative that is cut, delay in steps\n"
        + "\n".join(lines) + '\n}\n\n\n'
        "def as_shown(name, value, kept):\n"
        '    """What a sensor shows of a value; kept: what it would have shown so far without its delay."""\n'
        "    scale, bias, cut, late = SENSORS[name]\n"
        "    value = value * scale + bias\n"
        "    kept.append(value - cut * minimum(value, 0.0))\n"
        "    at = maximum(len(kept) - 1 - late, 0.0)\n"
        "    before = int(at)\n"
        "    after = min(before + 1, len(kept) - 1)\n"
        "    return kept[before] + (at - before) * (kept[after] - kept[before])"
    )  # fmt: skip


def _rig(law: Law, program: Program, used: Mapping[str, list[str]]) -> str:
    made = next(m for m in program.functions if m.node.name == TOP)
    states = {f: law.values["states"][f] for f in used.get("states", [])}
    given = [one.name for one in law.inputs]
    usual = {"second": repr(law.second), "disturbance": "0.0", "posture": "0.0"}
    head = ", ".join(f"{n}={usual[n]}" if n in usual else n for n in given)
    where = {
        "x": "self.signals", "p": "RIG.copy()", "u": "inputs", "w": "self._scratch", "e": "EFFECTS.copy()",
        "s": "self._states", "g": "self._control",
    }  # fmt: skip
    lines = [
        "class Rig:",
        f'    """{law.rig.name}; begins at rest with the output at {law.start:g}."""', "",
        "    def __init__(self):",
        _record("signals", law.values["signals"]), _record("_states", states),
    ]  # fmt: skip
    lines += [_record(f"_{TILES[t]}", _zeros(program.records[t], used[TILES[t]])) for t in "wg" if t in made.tiles]
    lines += ["        self._before = None"]
    if law.sensors:
        lines += [
            "        self._kept = {name: [] for name in SENSORS}",
            "        self.shown = {}",
            "        self._show()",
        ]
    lines += ["", f"    def step(self, {head}):", f'        """One control step of {law.period:g} s.', ""]
    lines += [f"        {one.name}: {one.meaning}, {one.unit}" for one in law.inputs]
    lines += ['        """']
    for name in ("command", "second"):
        if name in given and f"{name}_rate" not in given:
            lines.append(
                f"        {name}_rate = 0.0 if self._before is None else ({name} - self._before.{name}) / PERIOD"
            )
    rows = {n: n if n in given or n in _rates(given) else "0.0" for n in INPUTS.names} | {"mode": repr(law.mode)}
    lines += ["        inputs = Record(" + ", ".join(f"{n}={v}" for n, v in rows.items()) + ")"]
    lines += ["        self._before = inputs.copy()"]
    arguments = ", ".join([*(where[t] for t in made.tiles), "SUBSTEPS", "PERIOD / SUBSTEPS"])
    lines += [f"        {TOP}({arguments})"]
    if law.sensors:
        lines += ["        self._show()", "", "    def _show(self):"]
        for one in law.sensors:
            field, k = law.places[one.signal]
            place = f"self.signals.{field}" + (f"[{k}]" if k >= 0 else "")
            lines.append(
                f"        self.shown[{one.signal!r}] = as_shown({one.signal!r}, {place}, self._kept[{one.signal!r}])"
            )
    return "\n".join(lines)


def _rates(given: list[str]) -> list[str]:
    return [f"{name}_rate" for name in ("command", "second") if name in given]


def _zeros(lanes: Any, wanted: list[str]) -> dict[str, Any]:
    rows = lanes.zeros(1)
    return {n: [0.0] * len(getattr(rows, n)) if getattr(rows, n).ndim == 2 else 0.0 for n in wanted}


def _record(name: str, values: Mapping[str, Any]) -> str:
    inner = ", ".join(f"{n}={v!r}" for n, v in values.items())
    body = textwrap.fill(inner, 108, initial_indent=" " * 12, subsequent_indent=" " * 12, break_long_words=False)
    return f"        self.{name} = Record(\n{body}\n        )" if inner else f"        self.{name} = Record()"
