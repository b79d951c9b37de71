"""Friction that builds up over a distance: LuGre and elasto-plastic contact against scipy, and all of it near null."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.core.errors import ConfigurationError
from cable_envs.diagnosis.model.hypotheses import hypotheses_for
from cable_envs.effects import EFFECTS
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay

PERIOD, STEPS = 0.01, 80
T = PERIOD * (np.arange(STEPS) + 1)
LEVEL, MASS, VISCOUS, LONG, STRIBECK = 4.0, 11.0, 20.0, 2e-4, 1e-2


def slips_always(r, v):
    return 1.0


def slips_near_breakaway(r, v):
    t = np.clip((abs(r) - 0.7) / 0.3, 0.0, 1.0)
    return 0.0 if r * v < 0.0 else t * t * (3.0 - 2.0 * t)


def known(slips, excess, force):
    """Position and speed of one mass with the equations of the two papers; z over its value at high speed."""
    times, forces = np.r_[0.0, T], np.r_[force[0], force]
    damping = 0.1 * np.sqrt(LEVEL / LONG * MASS)

    def rates(t, state):
        _, v, z = state
        g = 1.0 + excess / LEVEL * np.exp(-((v / STRIBECK) ** 2))
        change = (v - slips(z / g, v) * abs(v) * z / g) / LONG
        friction = LEVEL * z + damping * LONG * change + VISCOUS * v
        return [v, (np.interp(t, times, forces) - friction) / MASS, change]

    start = (0.0, 0.0, force[0] / LEVEL)  # in balance
    return solve_ivp(rates, (0.0, T[-1]), start, "LSODA", T, rtol=1e-8, atol=1e-11, max_step=2e-4).y[:2]


@pytest.mark.parametrize("excess", [0.0, 2.0], ids=["Dahl", "Stribeck"])
@pytest.mark.parametrize(
    ("name", "slips"), [("lugre_friction", slips_always), ("elastoplastic_friction", slips_near_breakaway)]
)
def test_bristles_against_scipy(name, slips, excess):
    force = 9.0 * np.sin(2 * np.pi * 2.5 * T) + 1.0
    drive = plant_for("linear_drive")
    changes = {
        "coulomb": LEVEL, "viscous": VISCOUS, f"{name}.displacement": LONG, "stribeck_friction.excess": excess,
        "stribeck_friction.velocity": STRIBECK,
    }  # fmt: skip
    values = drive.table.pack(changes)[:, None]
    wanted, errors = known(slips, excess, force), []
    for substeps in (10, 40):
        out = replay(
            drive, values, force, PERIOD, drive="force", signals=["position", "velocity"], substeps=substeps
        )[:, :, 0].T  # fmt: skip
        errors.append(max(np.abs(a - b).max() / np.ptp(b) for a, b in zip(out, wanted, strict=True)))
    assert errors[0] < 3e-3 and errors[1] < 8e-4  # of order 1, as the damping of bristles is taken at the start
    assert errors[1] < 0.35 * errors[0]


RUNS = {
    "drive": ("linear_drive", "analytic", "force", 20.0, 0.0, {}, 1.0),
    "hole, speed": ("cable_hole", "analytic", "speed", 0.01, 0.0, {}, 1.0),
    "hole, tension": ("cable_hole", "analytic", "tension", 20.0, 60.0, {}, 1.0),
    "sheath": ("tendon_sheath", "analytic", "position", 0.02, 0.0, {"load_friction": 2.0}, 1.0),
    "circuit": ("pulley_circuit", "analytic", "torque", 0.2, 0.0, {"brake_torque": 0.02}, 10.0),
}
SHORT = (0.0, 1e-12, 1e-11, 1e-10, 1e-9)
QUICK = ("drive", "hole, tension")


@pytest.mark.parametrize("run", [pytest.param(n, marks=[] if n in QUICK else [pytest.mark.slow]) for n in RUNS])
def test_a_short_distance_is_nearly_none(run):
    """The change of every signal falls in proportion to the distance, on a grid of steps that resolves none of it."""
    name, variant, drive, amplitude, offset, common, scale = RUNS[run]
    plant = plant_for(name, variant)
    effects = [
        "presliding_hysteresis.displacement",
        "lugre_friction.displacement",
        "elastoplastic_friction.displacement",
    ]
    if name == "pulley_circuit":
        effects.append("partial_slip.angle")
    changes = [{**common, **({effect: scale * d} if d else {})} for effect in effects for d in SHORT]
    values = np.array([plant.table.pack(change) for change in changes]).T
    signals = [s.name for s in plant.signals if s.name not in ("sliding", "phase", "slack_fraction", "out_of_range")]
    path = offset + amplitude * np.sin(2 * np.pi * 2 * T)
    out = replay(plant, values, path, PERIOD, drive=drive, signals=signals, substeps=20)
    for k in range(len(effects)):
        mine = out[:, :, k * len(SHORT) : (k + 1) * len(SHORT)]
        size = np.ptp(mine[:, :, 0], axis=0)
        changed = (np.abs(mine - mine[:, :, :1]).max(axis=0) / np.where(size > 0.0, size, 1.0)[:, None]).max(axis=0)
        assert changed[4] < 2e-3
        assert changed[1] < 2e-3 * changed[4] + 1e-9  # a thousandth of the distance


def test_a_gap_of_the_drive_that_is_nearly_none():
    """On the hole the inner loop of the tension goes on through it."""
    hole = plant_for("cable_hole")
    values = np.array([hole.table.pack({"backlash.gap": gap} if gap else {}) for gap in (0.0, 5e-11, 5e-9)]).T
    for drive, path in (("tension", 60.0 + 20.0 * np.sin(4 * np.pi * T)), ("speed", 0.01 * np.sin(4 * np.pi * T))):
        out = replay(hole, values, path, PERIOD, drive=drive, signals=["load_tension", "load_position"], substeps=20)
        change = np.abs(out - out[:, :, :1]).max(axis=0) / np.ptp(out[:, :, 0], axis=0)[:, None]
        assert change[:, 1].max() < 1e-3, (drive, change)


def test_at_most_one_formulation_is_on():
    both = {"lugre_friction": {"displacement": 1e-4}, "presliding_hysteresis": {"displacement": 1e-4}}
    with pytest.raises(ConfigurationError, match="both lugre_friction and presliding_hysteresis"):
        gym.make("cable_envs/CableHole-Position-Sine-v1", effects=both)


def test_they_are_no_hypotheses_unless_they_are_named():
    drive = plant_for("linear_drive")
    values = drive.table.unpack(drive.table.pack({}))
    new = {"lugre_friction", "elastoplastic_friction"}
    found = hypotheses_for(drive, values, {}, ["position"])
    assert not new & {h.canonical for h in found.asked} and new <= set(found.not_asked)
    named = hypotheses_for(drive, values, {}, ["position"], only=sorted(new))
    assert {h.canonical for h in named.asked} == new and not named.not_asked
    of_commands = {"command_delay", "dead_band", "quantised_command"}  # asked of a rotary joint where they are named
    assert {name for name, effect in EFFECTS.items() if not effect.hypothesis} == new | of_commands | {"slow_creep"}
