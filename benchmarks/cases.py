"""What is measured. Each case is a function (pairs, seconds) -> results; where a peer is missing it says why.

Steps are compared at ten integration substeps in each control step, whatever the tasks' own number is.
"""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import gymnasium as gym
import numpy as np

import cable_envs  # noqa: F401 (registers the environments)
from benchmarks.pairs import Contender, Result, compare, stepping
from benchmarks.training import against_sb3
from cable_envs.core.team import available_cores

HOLE, CIRCUIT = "cable_envs/CableHole-Position-Sine-v0", "cable_envs/PulleyCircuit-Position-Sine-v0"
TEN = {"substeps": 10}
PLANTS = {"hole": (HOLE, TEN), "circuit": (CIRCUIT, TEN), "chain": (CIRCUIT, {"plant": "chain", **TEN})}
BATCH = 1024
IDLE = 1.9
"""Two processes must together do this many times what one does before the speed of two threads says anything."""
CLOSE = 0.1  # an action near which nothing tears and the mechanisms keep moving


def single(env_id: str, **options: object) -> Contender:
    """``gymnasium.make(env_id)``, stepped from Python, reset where an episode ends."""
    env = gym.make(env_id, **options)
    env.reset(seed=1)
    action = np.full(env.action_space.shape, CLOSE, np.float32)

    def step() -> None:
        *_, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()

    return Contender(env_id.split("/")[-1], stepping(step, 1))


def batch(env: gym.vector.VectorEnv, name: str) -> Contender:
    """Any vector environment, stepped from Python; it resets its environments by itself."""
    env.reset(seed=1)
    actions = np.random.default_rng(0).uniform(-CLOSE, CLOSE, env.action_space.shape).astype(np.float32)
    return Contender(name, stepping(lambda: env.step(actions), env.num_envs))


def native(plant: str, n: int = BATCH, threads: int = 1) -> Contender:
    env_id, options = PLANTS[plant]
    made = gym.make_vec(env_id, num_envs=n, vectorization_mode="vector_entry_point", threads=threads, **options)
    return batch(made, f"native {n}, {threads} thread{'s' if threads > 1 else ''}")


def single_against_pendulum(pairs: int, seconds: float) -> Iterator[Result]:
    for plant in ("hole", "circuit"):
        env_id, options = PLANTS[plant]
        ours, other = single(env_id, **options), single("Pendulum-v1")
        yield compare(f"{plant}: single / Pendulum-v1", ours, other, 4.0, pairs, seconds)


def native_against_sync(pairs: int, seconds: float) -> Iterator[Result]:
    for plant, target in (("hole", 20.0), ("circuit", 20.0), ("chain", 5.0)):
        env_id, options = PLANTS[plant]
        sync = gym.vector.SyncVectorEnv([lambda i=env_id, o=options: gym.make(i, **o)] * BATCH)
        other = batch(sync, f"SyncVectorEnv {BATCH}")
        yield compare(f"{plant}: native / SyncVectorEnv, {BATCH}", native(plant), other, target, pairs, seconds)
        sync.close()


def native_against_envpool(pairs: int, seconds: float) -> Iterator[Result]:
    name = f"native / envpool Pendulum, {BATCH}, one core"
    try:
        import envpool
    except ImportError:
        yield Result(f"hole, circuit: {name}", ">= 5", note="envpool is not installed (pip install envpool)")
        return
    pool = envpool.make("Pendulum-v1", env_type="gymnasium", num_envs=BATCH, num_threads=1)
    pool.reset()
    actions = np.full((BATCH, 1), CLOSE, np.float32)
    other = Contender("envpool Pendulum (one substep)", stepping(lambda: pool.step(actions), BATCH))
    for plant in ("hole", "circuit"):
        yield compare(f"{plant}: {name}", native(plant), other, 5.0, pairs, seconds)


def _ceiling(pairs: int) -> float:
    """What two independent processes of plain arithmetic get done together, over one alone: 2 on two idle cores."""
    code = "import time; t = time.perf_counter()\nfor i in range(4_000_000): pass\nprint(time.perf_counter() - t)"

    def slowest(count: int) -> float:
        command = [sys.executable, "-S", "-c", code]
        running = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(count)]
        return max(float(process.communicate()[0]) for process in running)

    return float(np.median([2 * slowest(1) / slowest(2) for _ in range(pairs)]))


def two_threads_against_one(pairs: int, seconds: float) -> Iterator[Result]:
    if available_cores() < 2:
        yield Result("two threads / one", ">= 1.8", note="one core only")
        return
    ceiling = _ceiling(pairs)
    idle = ceiling >= IDLE
    yield Result("machine: two processes / one", "", ceiling, (ceiling, ceiling), None, {}, pairs)
    for plant in PLANTS:
        for n in (BATCH, 8 * BATCH):
            result = compare(
                f"{plant}: two threads / one, {n}", native(plant, n, 2), native(plant, n), 1.8, pairs, seconds
            )  # fmt: skip
            reason = f"not judged: the machine itself gives {ceiling:.2f}, other work or a quota takes its cores"
            yield result if idle else replace(result, met=None, note=reason)


def training_share(pairs: int, seconds: float) -> Iterator[Result]:
    """Share of PPO's time that is spent in the environment, learning the shipped tasks with the shipped settings."""
    name = "PPO: share of the time in the environment"
    try:
        import torch
        from stable_baselines3 import PPO
    except ImportError:
        yield Result(name, "<= 5 %", note="needs the extra 'agents'")
        return
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.vec_env import CableVecEnv

    torch.set_num_threads(1)
    for env_id in (HOLE, CIRCUIT):
        settings = load_settings("ppo", env_id)
        env = CableVecEnv(
            env_id, settings.n_envs, stagger=settings.stagger, smoothing=settings.smoothing, **settings.env_options
        )
        inside = [0.0]
        step_wait = env.step_wait

        def timed(wait: Callable = step_wait, total: list[float] = inside) -> tuple:
            begin = time.perf_counter()
            out = wait()
            total[0] += time.perf_counter() - begin
            return out

        env.step_wait = timed
        model = PPO(
            settings.policy, env, policy_kwargs=settings.policy_arguments(), seed=0, device="cpu",
            **settings.arguments(),
        )  # fmt: skip
        rollout, shares, rates = model.n_steps * env.num_envs, [], []
        model.learn(rollout)
        for _ in range(pairs):
            inside[0], begin = 0.0, time.perf_counter()
            model.learn(rollout, reset_num_timesteps=False)
            passed = time.perf_counter() - begin
            shares.append(inside[0] / passed)
            rates.append(rollout / passed)
        share = float(np.median(shares))
        quartiles = tuple(np.quantile(shares, [0.25, 0.75]).tolist())
        yield Result(
            f"{env_id.split('/')[1].split('-')[0]}: {name}", "<= 0.05", share, quartiles, share <= 0.05,
            {"PPO": float(np.median(rates))}, pairs,
        )  # fmt: skip
        env.close()


def _python(code: str) -> float:
    """Seconds that ``code`` says it took, in a fresh interpreter."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def start_up(pairs: int, seconds: float) -> Iterator[Result]:
    """Import, against Gymnasium's own import; and from nothing to the first step with a warm cache."""
    clock = "import time; t = time.perf_counter(); {}; print(time.perf_counter() - t)"
    ours = clock.format("import cable_envs")
    theirs = clock.format("import gymnasium")
    first = clock.format(
        f"import gymnasium, cable_envs; e = gymnasium.make('{HOLE}'); e.reset(seed=0); e.step(e.action_space.sample())"
    )
    times = np.array([[_python(code) for code in (ours, theirs, first)] for _ in range(pairs)])
    ratios, median = times[:, 0] / times[:, 1], np.median(times, axis=0)
    value, quartiles = float(np.median(ratios)), tuple(np.quantile(ratios, [0.25, 0.75]).tolist())
    yield Result(
        "import cable_envs / import gymnasium", "<= 1.3", value, quartiles, value <= 1.3, {}, pairs,
        f"{median[0] * 1e3:.0f} ms against {median[1] * 1e3:.0f} ms",
    )  # fmt: skip
    quartiles = tuple(np.quantile(times[:, 2], [0.25, 0.75]).tolist())
    yield Result("import to first step, s", "", float(median[2]), quartiles, None, {}, pairs, "kernels compiled before")


def memory(pairs: int, seconds: float) -> Iterator[Result]:
    from cable_envs.sim.buffers import Buffers
    from cable_envs.sim.setup import make_setup

    for plant, (env_id, options) in PLANTS.items():
        setup = make_setup(**{**gym.spec(env_id).kwargs, **options})
        n = 10_000
        buffers = Buffers.of(setup, n)
        each = (buffers.block.nbytes + buffers.obs.nbytes) / n
        yield Result(f"{plant}: bytes of an environment in a batch", "", each, (each, each))


CASES = {
    "single": single_against_pendulum,
    "sync": native_against_sync,
    "envpool": native_against_envpool,
    "threads": two_threads_against_one,
    "training": training_share,
    "sb3": against_sb3,
    "start": start_up,
    "memory": memory,
}
