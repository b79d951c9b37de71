"""What `python -m benchmarks.gpu` measures; each function is one piece and returns what JSON can hold."""

import importlib.util
import os
import time
from pathlib import Path

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)
from benchmarks.gpu.work import work_of
from cable_envs.core.compiling import device
from cable_envs.core.errors import ConfigurationError
from cable_envs.sim.registered import setup_of
from cable_envs.sim.simulation import Simulation

CASES = {
    "hole": ("CableHole-Position-Sine-v1", {}),
    "three holes": ("CableHole-Position-Sine-v1", {"rig": "gu-three-holes"}),
    "circuit": ("PulleyCircuit-Torque-Sine-v1", {}),
    "circuit as a chain": ("PulleyCircuit-Torque-Sine-v1", {"plant": "chain"}),
    "sheath": ("TendonSheath-Position-Sine-v1", {}),
    "joint": ("AntagonistJoint-Torque-Sine-v1", {}),
    "wrist": ("Wrist-Position-Sine-v1", {}),
}
"""Name -> id and options."""

CPU_SIZES = (1024, 16384)
SIZES = (1024, 8192, 65536, 524288, 2097152)
"""Environments of a batch."""

ENDLESS = 1e6
"""Length of the episodes while steps are timed, s: what a new episode costs is measured by itself."""

SHAKE = 0.05
"""Actions go so far to both sides of what holds the mechanism, in turns; it stays where it is."""

SHARE = 0.8
"""Of a device's free memory that a batch may take."""

ROOT = Path(__file__).parents[2]
PPO_STEPS, PPO_ENVS = 500_000, 64
PPO_UPDATES = (8, 16, 32, 64, 128)
"""Updates after which an agent on the device is compared with the one on the CPU, each trained from the beginning."""


def device_name():
    """Name of the GPU, or None where there is none."""
    try:
        cuda = device.module()
    except ConfigurationError:
        return None
    if device.simulated():
        return "numba's simulator"
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else name


def devices():
    """How many GPUs there are."""
    if device_name() is None:
        return 0
    return 1 if device.simulated() else len(device.module().gpus)


def work(case):
    """Operations, bytes and integration steps of a control step, counted."""
    env_id, options = CASES[case]
    return vars(work_of(env_id, **options))


def episodes(case, n=4096):
    """Steps of an episode, and time in which the host prepares the first state of one, s."""
    env_id, options = CASES[case]
    setup = setup_of(f"cable_envs/{env_id}", options)
    simulation, lanes = Simulation(setup, n), np.arange(n)
    generators = [np.random.default_rng(i) for i in range(n)]
    taken = []
    for _ in range(3):  # the first compiles
        began = time.process_time()
        simulation.reset(lanes, generators)
        taken.append(time.process_time() - began)
    return {"steps": setup.steps, "each": min(taken) / n}


def _batch(case, n, **options):
    env_id, own = CASES[case]
    envs = gym.make_vec(f"cable_envs/{env_id}", n, step_infos=False, duration=ENDLESS, **own, **options).unwrapped
    if options.get("device") == "cuda":  # generators of a million environments take a quarter of a minute
        keys = np.arange(1.0, n + 1)[:, None]
        envs._draws = lambda lanes: keys[lanes]
        envs.reset()
        hold = envs.last_actions.copy_to_host()[:, None]
    else:
        envs.reset(seed=0)
        hold = np.array(envs.last_actions)[:, None]
    sides = np.random.default_rng(0).choice([-SHAKE, SHAKE], hold.shape)
    actions = [np.clip(hold + sign * sides, -1.0, 1.0).astype(np.float32) for sign in (1, -1)]
    if options.get("device") == "cuda":
        actions = [device.module().to_device(one) for one in actions]
    return envs, actions


def _rate(envs, actions, seconds, clock):
    """Steps a second of all environments together; `step` waits for the device."""
    for one in actions:
        envs.step(one)
    done, began = 0, clock()
    while done == 0 or clock() - began < seconds:
        for one in actions:
            envs.step(one)
        done += len(actions) * envs.num_envs
    return done / (clock() - began)


def on_the_cpu(case, seconds, lock, sizes=CPU_SIZES):
    """Size -> steps a second of one core, by its own time."""
    found = {}
    for n in sizes:
        envs, actions = _batch(case, n, threads=1)
        with lock:
            found[str(n)] = _rate(envs, actions, seconds, time.process_time)
        envs.close()
    return found


def on_the_device(case, precision, seconds, lock, sizes=SIZES):
    """Size -> steps a second; sizes that its memory does not hold are left out."""
    found = {}
    _batch(case, 2, device="cuda", precision=precision)[0].step(np.zeros((2, 1)))  # compiles, beside other pieces
    for n in sizes:
        with lock:
            if bytes_of(case) * n > SHARE * free_memory():
                break
            envs, actions = _batch(case, n, device="cuda", precision=precision)
            found[str(n)] = _rate(envs, actions, seconds, time.perf_counter)
            envs.close()
            del envs, actions
    return found


def bytes_of(case):
    """Memory of one environment on the device: its state, and that of its next episode."""
    env_id, options = CASES[case]
    b = Simulation(setup_of(f"cable_envs/{env_id}", options), 1).buffers
    return 2 * (b.block.nbytes + b.obs.nbytes)


def free_memory():
    """Bytes of the device that are free."""
    return float("inf") if device.simulated() else device.module().current_context().get_memory_info().free


def _ppo():
    path = ROOT / "examples" / "ppo_native_batch.py"
    spec = importlib.util.spec_from_file_location("ppo_native_batch", path)
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def _silent(text):
    pass


def ppo_on_the_cpu(lock, steps=PPO_STEPS, envs=PPO_ENVS):
    """Training of the example on one core: steps, seconds by its own time, and the error of its agent, m."""
    ppo = _ppo()
    ppo.train(envs * ppo.STEPS, 0, _silent, "cpu", envs)  # compiles
    with lock:
        began = time.process_time()
        agent = ppo.train(steps, 0, _silent, "cpu", envs)
        taken = time.process_time() - began
    return {"steps": steps, "seconds": taken, "error": ppo.tracking_error(agent, 20.0)}


def ppo_on_the_device(lock, score, envs=8192, updates=PPO_UPDATES):
    """The same on the device, trained longer each time until the agent is as good as ``score``, m."""
    ppo, tried = _ppo(), []
    ppo.train(envs * ppo.STEPS, 0, _silent, "cuda", envs)  # compiles
    for count in updates:
        steps = count * envs * ppo.STEPS
        with lock:
            began = time.perf_counter()
            agent = ppo.train(steps, 0, _silent, "cuda", envs)
            taken = time.perf_counter() - began
        tried.append({"steps": steps, "seconds": taken, "error": ppo.tracking_error(agent, 20.0)})
        if tried[-1]["error"] <= score:
            break
    return tried


def diagnosis(where, lock, recording=ROOT / "examples" / "sample_rig"):
    """Seconds of the diagnosis of a recording: of the core's own time, or with a device of the wall."""
    from cable_envs.diagnosis.engine import diagnose
    from cable_envs.sim.replay import replays_on

    clock = time.process_time if where == "cpu" else time.perf_counter
    with replays_on(where), lock:
        began = clock()
        diagnose(recording)
        return clock() - began


def shard(number, seconds, barrier, size=SIZES[2]):
    """Steps a second of one of several batches of the hole, each on a GPU of its own, all at the same time."""
    os.environ["CUDA_VISIBLE_DEVICES"] = str(number)
    envs, actions = _batch("hole", size, device="cuda", precision="float32")
    envs.step(actions[0])  # compiles
    barrier.wait()
    return _rate(envs, actions, seconds, time.perf_counter)
