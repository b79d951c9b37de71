"""The shell of every plant's kernel: blocks of columns into tiles on the stack, the plant's stages, and back.

It is written once; `kernels` fills in what is a plant's own: its rows and its ``solve``, the loop over substeps.
"""

from collections.abc import Callable
from typing import Any

from cable_envs.core.compiling.templates import instantiate, specialised
from cable_envs.core.inputs import INPUTS
from cable_envs.core.kernels import LANES, load, store
from cable_envs.core.lanes import Lanes
from cable_envs.effects.bristles import deflection

input_tile = INPUTS.tile
# filled in for each plant
signal_tile: Any = None
coefficient_tile: Any = None
scratch_tile: Any = None
effect_tile: Any = None
state_tile: Any = None
step_tile: Any = None
solve: Any = None
SIGNALS = COEFFICIENTS = EFFECTS = 0


def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; without effects."""
    xt, pt, ut, wt = signal_tile(), coefficient_tile(), input_tile(), scratch_tile()
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt.rows, x[:SIGNALS], first, lanes)
        load(pt.rows, p[:COEFFICIENTS], first, lanes)
        load(ut.rows, u, first, lanes)
        solve(xt, pt, ut, wt, None, None, None, lanes, substeps, dt)
        store(xt.rows, x[:SIGNALS], first, lanes)


def advance_with_effects(x, p, u, lo, hi, substeps, dt):
    """The same with effects; x and p have their rows."""
    xt, pt, ut, wt = signal_tile(), coefficient_tile(), input_tile(), scratch_tile()
    et, st, gt = effect_tile(), state_tile(), step_tile()
    for first in range(lo, hi, LANES):
        lanes = min(LANES, hi - first)
        load(xt.rows, x[:SIGNALS], first, lanes)
        load(pt.rows, p[:COEFFICIENTS], first, lanes)
        load(ut.rows, u, first, lanes)
        load(et.rows, p[COEFFICIENTS : COEFFICIENTS + EFFECTS], first, lanes)
        load(st.rows, x[SIGNALS:], first, lanes)
        solve(xt, pt, ut, wt, et, st, gt, lanes, substeps, dt)
        store(xt.rows, x[:SIGNALS], first, lanes)
        store(st.rows, x[SIGNALS:], first, lanes)


def kernels(
    name: str, signals: Lanes, coefficients: Lanes, scratch: Lanes, effects: Lanes, states: Lanes, step: Lanes,
    solve: Callable, hooks: dict[str, Any],
) -> tuple[Callable[..., None], ...]:  # fmt: skip
    """The kernels (x, p, u, lo, hi, substeps, dt) of a plant, compiled on first use.

    They are: without effects, with them, and with the friction that has bristles besides.
    hooks: what takes the place of pieces at the seams (`cable_envs.effects.own`), by their names.
    """
    own = {
        "signal_tile": signals.tile, "coefficient_tile": coefficients.tile, "scratch_tile": scratch.tile,
        "effect_tile": effects.tile, "state_tile": states.tile, "step_tile": step.tile,
        "solve": specialised(solve, **hooks),
        "SIGNALS": signals.count, "COEFFICIENTS": coefficients.count, "EFFECTS": effects.count,
    }  # fmt: skip
    plain, with_effects = (instantiate(f, f"{name}_{f.__name__}", **own) for f in (advance, advance_with_effects))
    own["solve"] = specialised(solve, **hooks, bristle_length=deflection)
    return plain, with_effects, instantiate(advance_with_effects, f"{name}_advance_with_bristles", **own)
