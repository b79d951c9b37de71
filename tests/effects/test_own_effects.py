"""A user's own effect from a file: compiled into a copy of the kernel, compared with solve_ivp; mistakes are named."""

import gymnasium as gym
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cable_envs.core.compiling.templates import names_within
from cable_envs.core.errors import ConfigurationError
from cable_envs.effects import Effect, EffectParameter
from cable_envs.effects.own import joined
from cable_envs.plants import families, plant_for
from cable_envs.plants.own_effects import load_effect, with_own_effects
from cable_envs.sim.replay import replay
from cable_envs.sim.rigs import load_rig

SPRING = """
from cable_envs.effects import Effect, EffectParameter
from cable_envs.effects import EffectState as S

def spring(position, velocity, tension, cubic, centre):
    return cubic * (position - centre) ** 3

EFFECT = Effect(
    name="cubic_spring", seam="load", equation="F = -cubic (y - centre)^3", source="a test", validity="small",
    experiment="push", plants=("linear_drive", "pulley_circuit"), hooks={"load": spring},
    parameters=(EffectParameter("cubic", "N/m^3", 0.0, 0.0, 1e9, "cubic stiffness", 1e5),
                EffectParameter("centre", "m", 0.0, -1.0, 1.0, "where it is relaxed", 0.0, shape=True)),
)
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "spring.py"
    path.write_text(SPRING)
    return path


def test_cubic_spring_against_solve_ivp(file):
    plant = with_own_effects(plant_for("linear_drive"), (load_effect(file),))
    t = (np.arange(100) + 1) * 0.01
    force = 30.0 * np.sin(2 * np.pi * t)
    changes = {"cubic_spring.cubic": 1e5, "cubic_spring.centre": 0.01, "coulomb": 0.0, "viscous": 20.0}
    values = np.array([plant.table.pack(changes), plant.table.pack({**changes, "cubic_spring.cubic": 0.0})]).T
    out = replay(plant, values, force, 0.01, drive="force", signals=["position"], substeps=20)
    times, forces = np.r_[0.0, t], np.r_[force[0], force]

    def rates(s, z):
        return [z[1], (np.interp(s, times, forces) - 20.0 * z[1] - 1e5 * (z[0] - 0.01) ** 3) / 11.0]

    run = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0], t_eval=t, rtol=1e-9, atol=1e-12, max_step=2e-3)
    assert out[:, 0, 0] == pytest.approx(run.y[0], abs=1e-5 * np.abs(run.y[0]).max() * 4)  # order 2 at 0.5 ms
    drive = plant_for("linear_drive")
    values = drive.table.pack({"coulomb": 0.0, "viscous": 20.0})[:, None]
    plain = replay(drive, values, force, 0.01, drive="force", signals=["position"], substeps=20)
    assert np.array_equal(out[:, 0, 1], plain[:, 0, 0])  # at null it is absent, to the bit


@pytest.mark.slow
def test_in_an_environment(file):
    arguments = {"duration": 0.5, "effect_file": file}
    seen = []
    for stiffness in (0.0, 50.0):
        env = gym.make(
            "cable_envs/PulleyCircuit-Position-Sine-v0", effects={"cubic_spring": {"cubic": stiffness}}, **arguments
        )
        env.reset(seed=1)
        for _ in range(30):
            *_, info = env.step(np.array([0.2], np.float32))
        seen.append(info["output_torque"])
    assert abs(seen[0] - seen[1]) > 0.05
    with pytest.raises(ConfigurationError, match="unknown effect 'cubic_spring'"):
        gym.make("cable_envs/PulleyCircuit-Position-Sine-v0", effects={"cubic_spring": {"cubic": 1.0}})
    with pytest.raises(ConfigurationError, match="'cubic_spring' does not act on cable_hole"):
        gym.make("cable_envs/CableHole-Position-Sine-v0", **arguments)


def test_a_rig_may_name_it_where_its_file_is_given(file, tmp_path):
    rig = tmp_path / "augmented.yaml"
    rig.write_text("""
schema: cable-rig/1
name: augmented
plant: linear_drive
effects: {cubic_spring: {cubic: {value: 2.0, unit: N/m^3}}}
""")
    assert load_rig(rig, (load_effect(file),)).effects == {"cubic_spring.cubic": 2.0}
    with pytest.raises(ConfigurationError, match=r"augmented\.yaml: unknown effect 'cubic_spring'"):
        load_rig(rig)


MISTAKES = [
    ("x = 1", "it must define EFFECT"), ("1 / 0", "ZeroDivisionError"),
    (SPRING.replace('"cubic_spring"', '"backlash"'), "that of a canonical effect"),
    (SPRING.replace('"load": spring', '"lode": spring'), "did you mean 'load'"),
    (SPRING.replace("tension, cubic, centre)", "cubic)"), "the hook 'load' uses 'centre', which it neither asks for"),
    (SPRING.replace("velocity, tension, cubic, centre)", "centr)"), "asks for 'centr', .*did you mean 'centre'"),
    (SPRING.replace("cubic, centre)", "cubic, centre=0.0)"), "plain arguments without defaults"),
    (SPRING.replace('seam="load",', 'seam="load", states=(S("a", "m"),),'), "nothing advances the state 'a'"),
    (SPRING.replace('seam="load",', 'seam="load", states=(S("a", "m"),), advance={"b": spring},'), "nothing advances"),
    (SPRING.replace('seam="load",', 'seam="load", states=(S("a", "m"),), advance={"a": spring, "b": spring},'),
     "unknown state that something advances .*'b'; did you mean|unknown state that something advances"),
    (SPRING.replace('seam="load",', 'seam="load", states=(S("cubic", "m"),), advance={"cubic": spring},'),
     "'cubic' is the name of two things"),
    (SPRING.replace('seam="load",', 'seam="cable", states=(S("a", "m"),), advance={"a": abs},'), "a hook at its seam"),
    (SPRING.replace('seam="load",', 'seam="load", states=(S("a", "m"),), advance={"a": lambda a, acceleration: a},'),
     "what advances 'a' asks for 'acceleration', which there is not; .*Valid: a, centre, cubic, dt, position"),
    (SPRING.replace('hooks={"load": spring}', "hooks={}"), "no hooks"),
    (SPRING.replace('seam="load"', 'seam="lode"'), "seam 'lode' is none of"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "message"), MISTAKES, ids=[m for _, m in MISTAKES])
def test_mistakes_are_named(tmp_path, text, message):
    path = tmp_path / "own.py"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        load_effect(path)


def test_the_same_content_is_the_same_effect_and_an_edited_file_is_another(file):
    """What is made of an effect (plants, kernels) is found again by what the file says, and not made at every call."""
    first, plant = load_effect(file), plant_for("linear_drive")
    assert load_effect(str(file)) is first
    assert with_own_effects(plant, (load_effect(file),)) is with_own_effects(plant, (first,))
    file.write_text(SPRING.replace("** 3", "** 5"))
    edited = load_effect(file)
    assert edited is not first and with_own_effects(plant, (edited,)) is not with_own_effects(plant, (first,))
    file.write_text(SPRING)
    assert load_effect(file) is first


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ConfigurationError, match="there is no such file"):
        load_effect(tmp_path / "none.py")


@pytest.mark.parametrize("plant", [p for f in families().values() for p in (plant_for(f.name, v) for v in f.variants)])
def test_a_plant_asks_at_the_seams_that_it_says(plant):
    asked = {name.removeprefix("own_") for name in names_within(plant.solve) if name.startswith("own_")}
    assert asked == set(plant.effects.acting.seams)


def test_an_effect_of_the_library_with_a_hook_needs_no_other_file():
    """What `cable_envs.effects.library` would find: it acts on every plant that asks at its seam, and on no other."""
    parameter = EffectParameter("stiffness", "N/m^3", 0.0, 0.0, 1e8, "spring to ground", typical=5e3)
    effect = Effect(
        name="cubic_spring", seam="contact", equation="mu += stiffness v^3", source="made up", parameters=(parameter,),
        validity="any", experiment="push", hooks={"contact": lambda speed, tension, stiffness: stiffness * speed**3},
    )  # fmt: skip
    hole, circuit = plant_for("cable_hole").effects.acting, plant_for("pulley_circuit").effects.acting
    assert hole.bound(effect, "cable_hole").parameters and not circuit.bound(effect, "pulley_circuit").parameters
    assert set(joined([hole.bound(effect, "cable_hole")])) == {"own_contact"}
    assert joined([circuit.bound(effect, "pulley_circuit")]) == {}
