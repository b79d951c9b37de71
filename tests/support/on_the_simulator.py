"""What `tests/envs/test_device.py` holds on numba's simulator of CUDA, in a process of its own.

``python -m tests.support.on_the_simulator NAME[:ARGUMENT] ...`` ends with an error where one of them does not hold. The
simulator is chosen when numba is imported, and is slow: batches of two or three and a few steps.
"""

import importlib.util
import sys
import tempfile
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import cable_envs
from benchmarks.gpu.precision import errors
from cable_envs.core.compiling.device import simulated
from cable_envs.plants import plant_for
from cable_envs.sim.replay import replay, replays_on

FEW = 8
"""Integration steps in a control step, so many as the rigs need."""


def there(value):
    return value.copy_to_host() if hasattr(value, "copy_to_host") else np.asarray(value)


def same(ours, device, where=()):
    if isinstance(ours, dict):
        assert set(ours) == set(device), where
        for name, value in ours.items():
            same(value, device[name], (*where, name))
    else:
        np.testing.assert_array_equal(ours, there(device), str(where), strict=True)


def both(env_id, n=2, **options):
    made = [gym.make_vec(f"cable_envs/{env_id}", num_envs=n, **options, **more) for more in ({}, {"device": "cuda"})]
    return [env.unwrapped for env in made]


def stepped(envs, steps, seed=3, size=1.0):
    """Both batches through the same actions: equal to the bit in all that they return."""
    rng = np.random.default_rng(seed)
    same(*(env.reset(seed=seed)[0] for env in envs))
    for t in range(steps):
        actions = rng.uniform(-size, size, envs[0].action_space.shape).astype(np.float32)
        ours, device = (env.step(actions) for env in envs)
        for k in range(5):
            same(ours[k], device[k], (t, k))
        assert envs[0].true_rig == envs[1].true_rig


def plant(env_id):
    """A plant's own kernel, with noise."""
    stepped(both(env_id, sensor_noise=True), 2)


def effects(_):
    """Kernels with effects, among them bristles, a delayed sensor, a delayed action and two actions."""
    stepped(both("CableHole-Position-Sine-v1", effects={"backlash": {"gap": 1e-4}}, action_delay=1, substeps=FEW), 3)
    late = {"sensor_delay": {"load_position": 0.013}, "lugre_friction": {"displacement": 1e-4, "damping": 0.3}}
    stepped(both("TendonSheath-Position-Sine-v0", effects=late, sensor_noise=True), 2)


def own_effect(_):
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "spring.py"
        file.write_text(
            "from cable_envs.effects.base import Effect, EffectParameter\n"
            "def _spring(position, stiffness):\n    return stiffness * position * position * position\n"
            "EFFECT = Effect(name='cubic_spring', seam='load', equation='F = k y^3', source='Duffing 1918',\n"
            "    parameters=(EffectParameter('stiffness', 'N/m^3', 0.0, 0.0, 1e9, 'spring', typical=5e3),),\n"
            "    validity='any', experiment='hold', confusable=(), hooks={'load': _spring})\n"
        )
        own = {"effect_file": str(file), "effects": {"cubic_spring": {"stiffness": 1e5}}}
        stepped(both("CableHole-Position-Sine-v1", substeps=FEW, **own), 2)


def autoreset(mode):
    """Episodes of four steps, with randomised rigs, random references and a reset of some of them between."""
    options = {"duration": 0.04, "substeps": FEW, "randomize": True, "sensor_noise": True}
    envs = both("CableHole-Position-Sine-v1", 3, autoreset_mode=AutoresetMode(mode), **options)
    stepped(envs, 6)
    some = {"rig": {"load_mass": 2.0}, "reset_mask": np.array([True, False, True])}
    same(*(env.reset(options=some)[0] for env in envs))
    actions = np.zeros((3, 1))
    for t in range(6):
        ours, device = (env.step(actions) for env in envs)
        for k in range(5):
            same(ours[k], device[k], (t, k))
        assert envs[0].true_rig == envs[1].true_rig


def disabled(_):
    envs = both("CableHole-Position-Sine-v1", autoreset_mode="Disabled", duration=0.01, substeps=FEW)
    for env in envs:
        with pytest.raises(gym.error.ResetNeeded):
            env.step(np.zeros((2, 1)))
    stepped(envs, 1)
    for env in envs:
        with pytest.raises(gym.error.ResetNeeded, match="have finished"):
            env.step(np.zeros((2, 1)))


def refused(_):
    """What the device cannot do is refused by name."""
    name = "cable_envs/CableHole-Position-Sine-v1"
    for options, words in (
        ({"device": "gpu"}, "cuda"), ({"device": "cuda", "precision": "float46"}, "float64"),
        ({"precision": "float32"}, "device='cuda'"), ({"device": "cuda", "threads": 2}, "threads"),
        ({"device": "cuda", "render_mode": "rgb_array"}, "render_mode"),
    ):  # fmt: skip
        with pytest.raises(cable_envs.ConfigurationError, match=words):
            gym.make_vec(name, num_envs=2, **options)
    env = gym.make_vec(name, num_envs=2, device="cuda", substeps=FEW).unwrapped
    env.reset(seed=1)
    with pytest.raises(ValueError, match="shape"):
        env.step(np.zeros((3, 1)))
    with pytest.raises(ValueError, match=r"\[1\] are not"):
        env.step(np.array([[0.0], [np.nan]]))
    with pytest.raises(cable_envs.ConfigurationError, match="saved states"):
        env.state()


def episode(env_id):
    """A whole episode as it is by default, with noise: equal to the bit from the first step to the last."""
    envs = both(env_id, 1, sensor_noise=True)
    stepped(envs, envs[0].setup.steps)
    assert envs[0]._any_finished and envs[1]._any_finished


def shards(_):
    """Two batches whose seeds follow one another are one batch of their size: several devices need nothing else."""
    options = {"substeps": FEW, "randomize": True, "sensor_noise": True, "device": "cuda"}
    whole, *parts = (gym.make_vec("cable_envs/CableHole-Position-Sine-v1", n, **options) for n in (4, 2, 2))
    seen = [there(env.reset(seed=seed)[0]) for env, seed in ((whole, 5), (parts[0], 5), (parts[1], 7))]
    np.testing.assert_array_equal(seen[0], np.concatenate(seen[1:]))
    actions = np.linspace(-1.0, 1.0, 4)[:, None]
    for _ in range(2):
        seen = [
            there(env.step(a)[0]) for env, a in ((whole, actions), (parts[0], actions[:2]), (parts[1], actions[2:]))
        ]
        np.testing.assert_array_equal(seen[0], np.concatenate(seen[1:]))


def single(_):
    """The equations in single precision: near those in double, and not the same. Those in double are the CPU's."""
    off, _ = errors("CableHole-Position-Sine-v1", {"substeps": FEW}, 5)
    assert off["float64"][0].max() == off["float64"][1] == 0.0
    # a state of 0.1 m is rounded to 4e-9 m at every step, which the cable's 1e5 N/m make 4e-4 N; scales are 50 N
    assert 0.0 < off["float32"][0].max() < 1e-3, off


def contacts(_):
    """Contacts in series that slide, in single precision: their tolerances can be kept, or a step would not end."""
    env = gym.make_vec(
        "cable_envs/CableHole-Position-Sine-v1", 1, rig="gu-three-holes", device="cuda", precision="float32"
    )
    env.reset(seed=1)
    began = time.process_time()
    for action in (0.3, 0.6, 0.9):
        env.step(np.full((1, 1), action))
    assert time.process_time() - began < 5.0  # 0.1 s; with the tolerances of double precision more than 40 s a step


def example(_):
    """PPO of examples/ppo_native_batch.py learns the same from the device's environments as from the CPU's."""
    path = Path(__file__).parents[2] / "examples" / "ppo_native_batch.py"
    spec = importlib.util.spec_from_file_location("ppo_native_batch", path)
    ppo = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ppo)
    ppo.STEPS = 4
    told = {on: [] for on in ("cpu", "cuda")}
    ends = [ppo.run(8, 1, 0.1, told[on].append, on, 2) for on in told]
    assert told["cpu"] == told["cuda"]
    assert len(told["cpu"]) == 1
    assert ends[0] == ends[1]


REPLAYED = {
    "linear_drive": ("force", "position", 30.0, {"stribeck_friction.excess": (0.0, 2.0, 3.0)}),
    "cable_hole": ("follow", "load_tension", 0.01, {"coulomb_friction.level": (0.0, 0.1, 0.2)}),
    "pulley_circuit": ("follow", "output_angle", 0.1, {}),
}


def replays(system):
    """Columns of different parameters through one record, with a state to go on from."""
    drive, signal, size, changes = REPLAYED[system]
    kind = plant_for(system)
    values = np.repeat([[parameter.default] for parameter in kind.table], 3, axis=1)
    for name, numbers in changes.items():
        values[kind.table.index(name)] = numbers
    command = size * np.sin(np.arange(1, 5) * 0.6)
    found, states = [], []
    for on in ("cpu", "cuda"):
        state = kind.rest(kind.prepare(values), np.zeros(3))
        with replays_on(on):
            found.append(replay(kind, values, command, 0.01, drive=drive, signals=[signal], state=state, substeps=FEW))
        states.append(state)
    same(*found)
    same(*states)
    assert np.ptp(found[0][:, 0, 0]) > 0.0


if __name__ == "__main__":
    assert simulated(), "NUMBA_ENABLE_CUDASIM=1 is missing"
    for what in sys.argv[1:]:
        print(what, file=sys.stderr)
        name, _, argument = what.partition(":")
        globals()[name](argument)
