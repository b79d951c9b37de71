"""The shell of every plant's kernel: blocks of columns into tiles on the stack, the plant's stages, and back.

It is written once; `kernels` fills in what is a plant's own: its rows and its ``solve``, the loop over substeps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cable_envs.core.compiling import device
from cable_envs.core.compiling.templates import instantiate, specialised
from cable_envs.core.inputs import INPUTS
from cable_envs.core.kernels import LANES, inline, load, store
from cable_envs.core.lanes import Lanes
from cable_envs.effects.bristles import deflection

# filled in for each plant
input_tile: Any = None
signal_tile: Any = None
coefficient_tile: Any = None
scratch_tile: Any = None
effect_tile: Any = None
state_tile: Any = None
step_tile: Any = None
solve: Any = None
SIGNALS = COEFFICIENTS = EFFECTS = 0


IN_SINGLE = {name: np.float32(value) for name, value in (
    ("EVEN", 1e-5), ("GRIP", 1.0 + 1e-5), ("LOOSE", 1e-6), ("SETTLED", 1e-6),
)}  # fmt: skip
"""What single precision can tell of contacts (`cable_envs.physics.chain`, `cable_envs.physics.series`), by the names of
their tolerances: with those of double precision their iterations would not end."""


@inline
def together(left):
    """How many of the columns that are left go through the stages together."""
    return min(LANES, left)


def _alone(left):
    return 1


@inline
def own_precision(dt):
    """The length of a step in the precision that the stages compute in."""
    return dt


def _single(dt):
    return np.float32(dt)


def advance(x, p, u, lo, hi, substeps, dt):
    """Move columns lo..hi by ``substeps`` steps of dt seconds, in place; without effects."""
    xt, pt, ut, wt = signal_tile(), coefficient_tile(), input_tile(), scratch_tile()
    for first in range(lo, hi, LANES):
        lanes = together(hi - first)
        load(xt.rows, x[:SIGNALS], first, lanes)
        load(pt.rows, p[:COEFFICIENTS], first, lanes)
        load(ut.rows, u, first, lanes)
        solve(xt, pt, ut, wt, None, None, None, lanes, substeps, own_precision(dt))
        store(xt.rows, x[:SIGNALS], first, lanes)


def advance_with_effects(x, p, u, lo, hi, substeps, dt):
    """The same with effects; x and p have their rows."""
    xt, pt, ut, wt = signal_tile(), coefficient_tile(), input_tile(), scratch_tile()
    et, st, gt = effect_tile(), state_tile(), step_tile()
    for first in range(lo, hi, LANES):
        lanes = together(hi - first)
        load(xt.rows, x[:SIGNALS], first, lanes)
        load(pt.rows, p[:COEFFICIENTS], first, lanes)
        load(ut.rows, u, first, lanes)
        load(et.rows, p[COEFFICIENTS : COEFFICIENTS + EFFECTS], first, lanes)
        load(st.rows, x[SIGNALS:], first, lanes)
        solve(xt, pt, ut, wt, et, st, gt, lanes, substeps, own_precision(dt))
        store(xt.rows, x[:SIGNALS], first, lanes)
        store(st.rows, x[SIGNALS:], first, lanes)


@dataclass(frozen=True)
class Rows:
    """The rows that a plant's kernel works on."""

    signals: Lanes
    coefficients: Lanes
    scratch: Lanes
    effects: Lanes
    states: Lanes
    step: Lanes

    def named(self, tile: Callable[[Lanes], Any]) -> dict[str, Any]:
        """What the shell reads of them, by its names. tile: what makes a block of rows."""
        return {
            "signal_tile": tile(self.signals), "coefficient_tile": tile(self.coefficients),
            "scratch_tile": tile(self.scratch), "effect_tile": tile(self.effects), "state_tile": tile(self.states),
            "step_tile": tile(self.step), "input_tile": tile(INPUTS), "SIGNALS": self.signals.count,
            "COEFFICIENTS": self.coefficients.count, "EFFECTS": self.effects.count,
        }  # fmt: skip


def kernels(name: str, rows: Rows, solve: Callable, hooks: dict[str, Any]) -> tuple[Callable[..., None], ...]:
    """The kernels (x, p, u, lo, hi, substeps, dt) of a plant, compiled on first use.

    They are: without effects, with them, and with the friction that has bristles besides.
    hooks: what takes the place of pieces at the seams (`cable_envs.effects.own`), by their names.
    """
    own = rows.named(lambda lanes: lanes.tile) | {"solve": specialised(solve, **hooks)}
    plain, with_effects = (instantiate(f, f"{name}_{f.__name__}", **own) for f in (advance, advance_with_effects))
    own["solve"] = specialised(solve, **hooks, bristle_length=deflection)
    return plain, with_effects, instantiate(advance_with_effects, f"{name}_advance_with_bristles", **own)


def device_kernel(rows: Rows, solve: Callable, hooks: dict[str, Any], number: int, precision: str) -> Any:
    """One of the `kernels`, by its number, as a piece of kernels for CUDA; each thread takes one column."""
    bristles = {"bristle_length": deflection} if number > 1 else {}
    own = rows.named(lambda lanes: device.tile(lanes, precision))
    own |= {"LANES": 1, "together": device.on_device(_alone)}  # a constant: rows of tiles then are registers
    if precision == "float32":
        own["own_precision"] = device.on_device(_single)
    coarser = IN_SINGLE if precision == "float32" else {}
    own["solve"] = device.on_device(specialised(solve, **hooks, **bristles), precision, **coarser)
    return device.on_device(advance_with_effects if number else advance, precision, **own)
