"""Stepping and PPO through `cable_envs.agents.vec_env.CableVecEnv`, against what stable-baselines3 makes by default.

SB3's default is ``make_vec_env(id, n_envs)``: one ``gymnasium.make`` for each environment, in a Monitor, stepped one
after another (DummyVecEnv), and n_envs is 1. Task, network, batch size and epochs are those of configs/agents/ppo.yaml
on both sides, on one thread; smoothing, which SB3 lacks, is off. A rollout has 2048 samples, one batch, however many
environments it comes from, so that the case stays short.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.pairs import Contender, Result, compare, stepping

ENVS = {"hole": "cable_envs/CableHole-Position-Sine-v0", "circuit": "cable_envs/PulleyCircuit-Position-Sine-v0"}
TARGET = 3.0
"""The least that "several times" means."""
PAIRS, SECONDS = 7, 0.25
"""Upper limits here: SB3's default takes more than a second for a rollout."""


def against_sb3(pairs: int, seconds: float) -> Iterator[Result]:
    """Environment steps alone, then training: the same number of environments, and SB3's default of one."""
    try:
        import torch
        from stable_baselines3.common.env_util import make_vec_env
    except ImportError:
        yield Result("CableVecEnv / SB3's default", f">= {TARGET:g}", note="needs the extra 'agents'")
        return
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.vec_env import CableVecEnv

    torch.set_num_threads(1)
    pairs, seconds = min(pairs, PAIRS), min(seconds, SECONDS)
    for name, env_id in ENVS.items():
        settings = replace(load_settings("ppo", env_id), smoothing=0.0)
        n, options = settings.n_envs, dict(settings.env_options)
        native: Callable[[], Any] = partial(CableVecEnv, env_id, n, **options)
        default: Callable[[int], Any] = partial(make_vec_env, env_id, env_kwargs=options)
        for k in (n, 1):
            title = f"{name}: steps, CableVecEnv {n} / DummyVecEnv {k}"
            yield compare(title, stepped(native()), stepped(default(k)), TARGET, pairs, seconds)
        for k in (n, 1) if name == "hole" else (n,):
            title = f"{name}: PPO, CableVecEnv {n} / DummyVecEnv {k}"
            result = compare(title, trained(native(), settings), trained(default(k), settings), TARGET, pairs, seconds)
            # with as many environments most of the time is the network's on either side: shown, not judged
            yield result if k == 1 else replace(result, target="", met=None)


def stepped(env: Any) -> Contender:
    """A VecEnv under random actions."""
    env.reset()
    actions = np.random.default_rng(0).uniform(-0.1, 0.1, (env.num_envs, 1)).astype(np.float32)
    return Contender(_name(env), stepping(lambda: env.step(actions), env.num_envs))


def trained(env: Any, settings: Any) -> Contender:
    """PPO on a VecEnv: whole rollouts, each with its update."""
    arguments = settings.arguments()
    samples = arguments["batch_size"]
    arguments["n_steps"] = samples // env.num_envs
    model = settings.algorithm()(
        settings.policy, env, policy_kwargs=settings.policy_arguments(), seed=0, device="cpu", **arguments
    )

    def run(seconds: float) -> float:
        begin, done = time.perf_counter(), 0
        while not done or time.perf_counter() - begin < seconds:
            model.learn(samples, reset_num_timesteps=False)
            done += samples
        return done

    return Contender(_name(env), run)


def _name(env: Any) -> str:
    return f"{type(env).__name__} {env.num_envs}"
