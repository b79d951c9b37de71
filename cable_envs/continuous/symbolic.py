"""The equations of a model as CasADi functions, with what has kinks rounded off.

The law is that of the plant, evaluated with symbols in place of numbers. What is rounded off:

    direction     the laws of both directions, mixed in the shares (1 +- tanh(v / v_s)) / 2
    |v|           sqrt(v^2 + (v_s / 10)^2) in what friction does with the speed
    slack         max(0, T) -> T_s ln(1 + exp(T / T_s)) in the pieces that hold the slack of a cable
    slip          what goes by a rate r between limits: r' = r + ((high - y) / (high - low))^8 p(r_low - r) - its mirror
                  image at the other limit, where p(x) = x (1 + tanh(10 x / v_s)) / 2 stands for max(0, x)

Limits of the drive stay as they are: their slopes jump. Where nothing slides, the smooth friction gives way instead of
holding: it creeps with speeds of the order of v_s times the load over the friction.
"""

from collections.abc import Callable
from itertools import product
from typing import Any, NamedTuple

from cable_envs.continuous.numbers import NUMBERS
from cable_envs.core.compiling.templates import interpreted
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.params import is_number

ROUND = 0.1
"""Speed over v_s below which |v| is rounded off."""
SHARP = 8.0
"""Exponent of the smooth slip: the higher, the later a spring begins to slip at its end (1: Dahl 1968)."""
NARROW = 1e-9
"""Least distance of two limits of a slip, m."""


class Smooth(NamedTuple):
    """What `cable_envs.continuous.models.Model.casadi` gives; ``f`` and ``h`` are `casadi.Function` of (x, u), SI."""

    f: Any
    h: Any
    speed: float
    """v_s, m/s or rad/s"""
    tension: float
    """T_s, N"""


class Symbol:
    """A CasADi expression that compares and combines as a number of a kernel does: conditions have & and |."""

    def __init__(self, value: Any):
        self.value = value


def _value(a: Any) -> Any:
    return a.value if isinstance(a, Symbol) else a


def _method(work: Callable[..., Any]) -> Callable[..., Symbol]:
    def method(self: Symbol, *others: Any) -> Symbol:
        return Symbol(work(self.value, *map(_value, others)))

    return method


def _equip() -> None:
    """Give `Symbol` its operators."""
    from casadi import SX, logic_and, logic_or

    names = ("add", "sub", "mul", "truediv", "pow")
    for name in (*names, *(f"r{n}" for n in names), "neg", "lt", "le", "gt", "ge", "eq", "ne"):
        setattr(Symbol, f"__{name}__", _method(getattr(SX, f"__{name}__")))
    for name, work in (("and", logic_and), ("rand", logic_and), ("or", logic_or), ("ror", logic_or)):
        setattr(Symbol, f"__{name}__", _method(work))


def _algebra() -> dict[str, Any]:
    """The functions of `cable_envs.core.kernels` for symbols; what has only numbers in it stays a number."""
    import casadi

    def of(name: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def function(*given):
            if any(isinstance(one, Symbol) for one in given):
                return Symbol(work(*map(_value, given)))
            return NUMBERS[name](*given)

        return function

    def select(condition, a, b):
        if isinstance(condition, Symbol):
            return Symbol(casadi.if_else(condition.value, _value(a), _value(b)))
        return a if condition else b

    maximum, minimum = of("maximum", casadi.fmax), of("minimum", casadi.fmin)
    raised, sine, cosine = of("power", casadi.power), of("sine", casadi.sin), of("cosine", casadi.cos)
    return {
        "select": select, "maximum": maximum, "minimum": minimum,
        "clip": lambda x, low, high: minimum(maximum(x, low), high),
        "abs": lambda x: select(x >= 0.0, x, -x),  # its slope at 0 is that of one side, as of a complex step
        "sign": lambda x: select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0)),
        "power": lambda x, y: select(x > 0.0, raised(maximum(x, 1e-300), y), 0.0),
        "sine_cosine": lambda x: (sine(x), cosine(x)),
        "apart": NUMBERS["apart"],
        **{name: of(name, getattr(casadi, name)) for name in ("exp", "expm1", "log", "sqrt")},
    }  # fmt: skip


def _rounded(algebra: dict[str, Any], speed: float, tension: float) -> dict[str, Any]:
    """What takes the place of the pieces of `cable_envs.plants.continuous`."""
    import casadi

    def along(v, way):
        return way * algebra["sqrt"](v * v + (ROUND * speed) ** 2)

    def engaged(pull, taut, limp):
        return limp + (taut - limp) * Symbol(0.5 * (1.0 + casadi.tanh(0.5 * _value(pull) / tension)))

    def contained(rate, y, low, high, low_rate, high_rate, unit=1.0):
        width, some = algebra["maximum"](high - low, NARROW), ROUND * speed * unit

        def share(x):
            return algebra["maximum"](1.0 - x / width, 0.0) ** SHARP

        def positive(x):
            return x * Symbol(0.5 * (1.0 + casadi.tanh(_value(x) / _value(some))))

        pushed, back = positive(low_rate - rate), positive(rate - high_rate)
        return rate + share(y - low) * pushed - share(high - y) * back

    return {"along": along, "engaged": engaged, "contained": contained, "again": lambda changed: True}


def _loose(piece: Callable[..., Any], algebra: dict[str, Any], width: float) -> Callable[..., Any]:
    """A piece that holds the slack of a cable, with the slack rounded off over ``width`` of its pull."""
    import casadi

    def maximum(a, b):
        if not (isinstance(b, float) and b == 0.0):
            return algebra["maximum"](a, b)
        over = _value(a) / width
        return Symbol(width * (casadi.fmax(over, 0.0) + casadi.log1p(casadi.exp(-casadi.fabs(over)))))

    def select(condition, a, b):
        if any(isinstance(one, float) and one == 0.0 for one in (a, b)):
            return b if isinstance(a, float) else a  # nothing where slack: the rounded maximum says that
        return algebra["select"](condition, a, b)

    return interpreted(piece, **{**algebra, "maximum": maximum, "select": select})


def smooth(model: Any, speed: float, tension: float) -> Smooth:
    """See `cable_envs.continuous.models.Model.casadi`; ``model`` is one."""
    try:
        import casadi
    except ImportError as error:
        raise ConfigurationError("CasADi functions need casadi: pip install 'cable-envs[casadi]'") from error
    for name, given in (("speed", speed), ("tension", tension)):
        if not is_number(given) or given <= 0.0:
            raise ConfigurationError(f"{name}: expected a smoothing above 0, got {given!r}")
    _equip()
    algebra, equations = _algebra(), model.equations
    names = {**algebra, **_rounded(algebra, speed, tension)}
    coefficients = model.rows([0.0] * len(model.inputs)).p
    for piece, per in equations.slack.items():
        width = tension * (getattr(coefficients, per)[0] if per else 1.0)
        names[piece.__name__] = _loose(piece, algebra, width)
    names |= {name: interpreted(piece, **names) for name, piece in equations.symbolic.items()}
    law = interpreted(equations.law, **names)
    x = casadi.SX.sym("x", len(model.states))
    u = casadi.SX.sym("u", len(model.inputs))
    state = [Symbol(x[k]) for k in range(len(model.states))]
    inputs = [Symbol(u[k]) for k in range(len(model.inputs))]

    def of(ways: tuple[float, ...]) -> tuple[Any, Any]:
        rates, shown = law(tuple(state), model.rows(inputs), *ways)
        return casadi.vertcat(*map(_value, rates)), casadi.vertcat(*map(_value, shown))

    entries = dict(zip([s.name for s in (*model.states, *model.inputs)], [*state, *inputs]))
    forward = [0.5 * (1.0 + casadi.tanh(entries[name].value / speed)) for name in equations.slides]
    rates, shown = 0.0, 0.0
    for ways in product((1.0, -1.0), repeat=len(forward)):
        share = 1.0
        for way, ahead in zip(ways, forward):
            share = share * (ahead if way > 0.0 else 1.0 - ahead)
        those, seen = of(ways)
        rates, shown = rates + share * those, shown + share * seen
    return Smooth(_function("f", x, u, rates), _function("h", x, u, shown), float(speed), float(tension))


def _function(name: str, x: Any, u: Any, value: Any) -> Any:
    import casadi

    return casadi.Function(name, [x, u], [value], ["x", "u"], [name])
