"""Arithmetic and memory traffic of a step of an environment, counted on the text of its kernel, without a device.

The plant's kernel runs as plain Python on numbers that count what is done with them: an addition, product, quotient or
root is one operation, a fused product and sum two. Bytes are those of the rows that a thread reads and writes of its
column of the block, once each in a control step.
"""

import math
import struct
from dataclasses import dataclass

import numpy as np

from cable_envs.core.compiling.templates import interpreted, specialised
from cable_envs.effects import backlash
from cable_envs.effects.own import joined
from cable_envs.plants import kernel
from cable_envs.sim.buffers import ENVIRONMENT
from cable_envs.sim.registered import setup_of
from cable_envs.sim.simulation import Simulation

STEPS = 20
"""Control steps that are counted and averaged, with actions drawn evenly."""


@dataclass(frozen=True)
class Work:
    """Of one control step of one environment."""

    operations: float
    traffic: int
    substeps: int


class Counting(float):
    """A float that counts the operations that it takes part in."""

    __array_ufunc__ = None  # NumPy's numbers leave the operation to this one
    done = 0

    def __neg__(self):
        return Counting(-float(self))

    def __abs__(self):
        return Counting(abs(float(self)))


def _counted(name):
    plain = getattr(float, name)

    def operation(self, other):
        Counting.done += 1
        try:
            return Counting(plain(float(self), float(other)))
        except ZeroDivisionError:
            return Counting(math.nan if float(self if "r" not in name[2:4] else other) == 0.0 else math.inf)

    return operation


for _name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv"):
    setattr(Counting, f"__{_name}__", _counted(f"__{_name}__"))


def _fused(a, b, c):
    Counting.done += 2
    return Counting(float(a) * float(b) + float(c))


def _root(x):
    Counting.done += 1
    return Counting(math.sqrt(x)) if x >= 0.0 else Counting(math.nan)


def _apart(*given):
    """Two pieces have this name: that of the kernels, and the side of a gap."""
    return given[0] if len(given) == 1 else interpreted(backlash.apart, **_PRIMITIVES)(*given)


_PRIMITIVES = {
    "select": lambda condition, a, b: a if condition else b, "_fma": _fused, "sqrt": _root, "apart": _apart,
    "to_bits": lambda x: struct.unpack("<q", struct.pack("<d", x))[0],
    "from_bits": lambda n: Counting(struct.unpack("<d", struct.pack("<q", n))[0]),
    "_shift_right_52": lambda n: n >> 52,
}  # fmt: skip


def _tile(lanes):
    rows = np.full((max(lanes.count, 1), 1), Counting(0.0), dtype=object)
    return lambda: lanes.over(rows)


def work_of(env_id, **options):
    """Counted work of an environment's step.

    Parameters
    ----------
    env_id : str
        Registered id, without the namespace.
    **options
        Of the environment.

    Returns
    -------
    Work
        Of the kernel that the environment uses.
    """
    setup = setup_of(f"cable_envs/{env_id}", options)
    plant, simulation = setup.plant, Simulation(setup, 1)
    simulation.reset(np.array([0]), [np.random.default_rng(0)])
    needed = max(simulation.with_effects, int(not plant.plain))
    shell = kernel.advance_with_effects if needed else kernel.advance
    hooks = joined(plant.effects.effects.values())
    names = plant.rows.named(_tile) | {"LANES": 1, "together": lambda left: 1}
    names["solve"] = interpreted(specialised(plant.solve, **hooks), **_PRIMITIVES)
    counted = interpreted(shell, **names)
    b, step, rng = simulation.buffers, simulation.advance(), np.random.default_rng(1)
    dt, total = setup.control_period / setup.substeps, 0
    for _ in range(STEPS):
        simulation.asked[:] = rng.uniform(-1.0, 1.0)
        before = np.vectorize(Counting, otypes=[object])
        x, p = before(b.x), before(b.p)
        step()
        Counting.done = 0
        counted(x, p, before(b.u.rows), 0, 1, setup.substeps, Counting(dt))
        total += Counting.done
    own = plant.coefficient_rows.count
    moved = 2 * len(plant.signals) + own + 2 * ENVIRONMENT.count + 4 * len(setup.sensors) + len(setup.channels) / 2
    moved += (2 * plant.effects.states.count + plant.effects.count) if needed else 0
    return Work(total / STEPS, round(8 * moved), setup.substeps)
