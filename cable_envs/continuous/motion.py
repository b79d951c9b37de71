"""Motion of a model by `scipy.integrate.solve_ivp`: each direction of sliding is integrated apart, events end it."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cable_envs.continuous.points import slopes
from cable_envs.continuous.ways import Ways, as_forced, told
from cable_envs.core.errors import ConfigurationError, require_known

OPTIONS = {"method": "DOP853", "rtol": 1e-8, "atol": 1e-10, "max_step": np.inf}
IMPLICIT = ("Radau", "BDF", "LSODA")
"""Methods that ask for the slopes of the rates."""
HELD = 1e-7
"""s for which friction holds what would move for a shorter time."""
MOST = 10000
"""Changes of direction between two times, beyond which something is wrong."""


@dataclass(frozen=True)
class Motion:
    """What a simulation gives, at N times.

    Attributes
    ----------
    t : ndarray, shape (N,)
        Times, s.
    x : ndarray, shape (N, states)
        States.
    u : ndarray, shape (N, inputs)
        Inputs.
    y : ndarray, shape (N, outputs)
        Outputs.
    sliding : ndarray of int, shape (N,), or (N, frictions) where there are several
        Directions of sliding.
    """

    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    y: np.ndarray
    sliding: np.ndarray


def integrate(model: Any, t: ArrayLike, u: Any, x0: ArrayLike, **options: Any) -> Motion:
    """See `cable_envs.continuous.models.Model.simulate`; ``model`` is one."""
    require_known("option", options, OPTIONS)
    times = np.asarray(t, dtype=np.float64)
    if times.ndim != 1 or len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise ConfigurationError("t: expected at least two times that grow")
    given = _inputs(model, u, len(times) - 1)
    usual = {**OPTIONS, "method": "BDF"} if model.equations.stiff else OPTIONS
    x = np.asarray(x0, dtype=np.float64)
    states, ways, taken = [x], [], []
    for k, (start, end) in enumerate(pairwise(times)):
        x, slide = _between(model, given(k), x, start, end, {**usual, **options})
        states.append(x)
        taken.append(given(k)(start))
        ways.append(slide)
    taken.append(given(len(times) - 2)(times[-1]))
    ways.insert(0, as_forced(model, states[0], taken[0]))
    shown = [model.h(*one) for one in zip(states, taken, ways)]
    return Motion(times, np.array(states), np.array(taken), np.array(shown), np.array([told(way) for way in ways]))


def _inputs(model: Any, u: Any, steps: int) -> Callable[[int], Callable[[float], np.ndarray]]:
    """Number of the interval -> the input over time."""
    if callable(u):
        return lambda k: lambda t: np.asarray(u(t), dtype=np.float64)
    array, width = np.asarray(u, dtype=np.float64), len(model.inputs)
    if array.shape not in ((width,), (steps, width)):
        raise ConfigurationError(f"u: expected [{width}], [{steps}, {width}] or a function, got shape {array.shape}")
    held = np.broadcast_to(array, (steps, width))
    return lambda k: lambda t: held[k]


def _between(model, u, x, start, end, options):
    """(state, directions of sliding) at ``end``."""
    from scipy.integrate import solve_ivp  # lazily: the rest of a model needs NumPy only

    ways, until = _followed(model, x, u(start)), end
    for _ in range(MOST):
        events = _events(model, u, ways, start) if until == end else []
        tests = [test for _, test in events]
        given = {"jac": _slopes(model, u, ways)} if options["method"] in IMPLICIT else {}
        run = solve_ivp(
            lambda t, z, ways=ways: model.f(z, u(t), ways), (start, until), x, events=tests, **given, **options
        )
        if not run.success:
            raise ConfigurationError(f"the integration stops at {run.t[-1]:g} s: {run.message}")
        before, start, x = start, run.t[-1], run.y[:, -1].copy()
        if run.status == 1:
            which, way = next(event for (event, _), times in zip(events, run.t_events) if times.size)
            x[model.places[which]] = 0.0
        if start >= end:
            return x, _seen(model, x, u(start), ways)
        if run.status == 1 and way == 0 and start - before < 2.0 * HELD:  # it would move and stop again at once
            ways, until = _changed(ways, which, 0), min(start + HELD, end)
        elif run.status == 1 and way != 0:
            ways, until = _changed(ways, which, way), end
        else:
            ways, until = _followed(model, x, u(start)), end
    raise ConfigurationError(f"more than {MOST} changes of direction until {start:g} s")


def _slopes(model: Any, u: Callable[[float], np.ndarray], ways: Ways) -> Callable[[float, np.ndarray], np.ndarray]:
    """Exact slopes of the rates: a difference looks past where a slip starts, and a solver's steps shrink there."""
    return lambda t, z: slopes(model, z, u(t), ways, inputs=False)[0][: len(z)]


def _followed(model: Any, x: np.ndarray, u: np.ndarray) -> Ways:
    """The directions that an integration goes on with; one without friction is none that could end."""
    found = zip(model.frictions, as_forced(model, x, u))
    return tuple(1 if name in model.equations.free else way for name, way in found)


def _seen(model: Any, x: np.ndarray, u: np.ndarray, ways: Ways) -> Ways:
    """The directions at the end of an integration."""
    found = zip(model.frictions, as_forced(model, x, u), ways)
    return tuple(now if name in model.equations.free else way for name, now, way in found)


def _changed(ways: Ways, which: int, way: int) -> Ways:
    return (*ways[:which], way, *ways[which + 1 :])


def _events(model, u, ways, start):
    """What ends directions of sliding: ((which friction, its way then), function of (t, x) that crosses zero there)."""
    found: list[Any] = []
    for which, (name, k) in enumerate(zip(model.frictions, model.places)):
        if k < 0 or name in model.equations.free:
            continue
        if ways[which] == 0:
            for way in (1, -1):
                then = _changed(ways, which, way)
                test = _crossing(lambda t, z, k=k, way=way, then=then: way * model.f(z, u(t), then)[k], 1)
                found.append(((which, way), test))
        else:
            # not at once: it may stop again within the first step of the integration
            test = _crossing(lambda t, z, k=k, way=ways[which]: way * z[k] + (1.0 if t <= start + HELD else 0.0), -1)
            found.append(((which, 0), test))
    return found


def _crossing(test, rises):
    test.terminal, test.direction = True, rises
    return test
