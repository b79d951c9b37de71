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
from cable_envs.core.kernels import LANES, inline, load, store, widest
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

BLOCK = 24
"""Columns that go through a record before the next ones do: their numbers stay in the cache."""


IN_SINGLE = {name: np.float32(value) for name, value in (
    ("EVEN", 1e-5), ("GRIP", 1.0 + 1e-5), ("LOOSE", 1e-6), ("SETTLED", 1e-6),
)}  # fmt: skip
"""What single precision can tell of contacts (`cable_envs.physics.chain`, `cable_envs.physics.series`), by the names of
their tolerances: with those of double precision their iterations would not end."""


@inline
def together(left):
    """How many of the columns that are left go through the stages together."""
    return min(LANES, left)


@inline
def of_a_record(left):
    """How many of the columns that are left go through a record together."""
    return min(BLOCK, left)


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


def replay_with_effects(x, p, inputs, rows, substeps, dt, out, lo, hi):
    """Move columns lo..hi through a whole record: their state and their effects stay in the tiles.

    inputs: rows that are alike for all columns [steps, rows], those that each has of its own [steps, k, n], and which
    these are [k]. out [steps, m, n]: the m signals ``rows`` after every step.
    """
    widest()
    xt, pt, ut, wt = signal_tile(), coefficient_tile(), input_tile(), scratch_tile()
    et, st, gt = effect_tile(), state_tile(), step_tile()
    for first in range(lo, hi, BLOCK):
        lanes = of_a_record(hi - first)
        load(xt.rows, x[:SIGNALS], first, lanes)
        load(et.rows, p[COEFFICIENTS : COEFFICIENTS + EFFECTS], first, lanes)
        load(st.rows, x[SIGNALS:], first, lanes)
        for t in range(out.shape[0]):
            load(pt.rows, p[:COEFFICIENTS], first, lanes)  # friction that has drifted changes them for a step
            _take(ut.rows, inputs, t, first, lanes)
            solve(xt, pt, ut, wt, et, st, gt, lanes, substeps, own_precision(dt))
            for k in range(rows.shape[0]):
                for i in range(lanes):
                    out[t, k, first + i] = xt.rows[rows[k], i]
        store(xt.rows, x[:SIGNALS], first, lanes)
        store(st.rows, x[SIGNALS:], first, lanes)


@inline
def _take(tile_, inputs, t, first, lanes):
    """The inputs of a step."""
    shared, own, places = inputs
    for row in range(shared.shape[1]):
        for i in range(lanes):
            tile_[row, i] = shared[t, row]
    for k in range(places.shape[0]):
        for i in range(lanes):
            tile_[places[k], i] = own[t, k, first + i]


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


@dataclass(frozen=True)
class Kernels:
    """What simulates a plant, compiled on first use."""

    steps: tuple[Callable[..., None], ...]
    """(x, p, u, lo, hi, substeps, dt): without effects, with them, and with the friction that has bristles besides"""
    replays: tuple[Callable[..., None], ...]
    """as `replay_with_effects`: with effects, and with bristles besides"""


def kernels(name: str, rows: Rows, solve: Callable, hooks: dict[str, Any]) -> Kernels:
    """A plant's kernels; hooks: what takes the place of pieces at the seams (`cable_envs.effects.own`), by name."""
    own = rows.named(lambda lanes: lanes.tile) | {"solve": specialised(solve, **hooks)}
    bristles = own | {"solve": specialised(solve, **hooks, bristle_length=deflection)}
    plain = instantiate(advance, f"{name}_advance", **own)
    step, step_with_bristles, replay, replay_with_bristles = (
        instantiate(text, f"{name}_{what}_with_{more}", **filled)
        for text, what in ((advance_with_effects, "advance"), (replay_with_effects, "replay"))
        for more, filled in (("effects", own), ("bristles", bristles))
    )
    return Kernels((plain, step, step_with_bristles), (replay, replay_with_bristles))


def device_kernel(
    shell: Callable, rows: Rows, solve: Callable, hooks: dict[str, Any], bristles: bool, precision: str
) -> Any:
    """A kernel of a plant as a piece of kernels for CUDA; each thread takes one column.

    shell: `advance`, `advance_with_effects` or `replay_with_effects`.
    """
    hooks = hooks | ({"bristle_length": deflection} if bristles else {})
    own = rows.named(lambda lanes: device.tile(lanes, precision))
    alone = device.on_device(_alone)
    # constants: rows of tiles then are registers
    own |= {"LANES": 1, "BLOCK": 1, "together": alone, "of_a_record": alone}
    if precision == "float32":
        own["own_precision"] = device.on_device(_single)
    coarser = IN_SINGLE if precision == "float32" else {}
    own["solve"] = device.on_device(specialised(solve, **hooks), precision, **coarser)
    return device.on_device(shell, precision, **own)
