"""Made-up but plausible store records: boards are tested without running an environment."""

import numpy as np

from cable_envs.core.files import jsonable
from cablebench.protocol.episode import Episode
from cablebench.protocol.metrics import measure
from cablebench.protocol.protocol import Protocol, SeedRange, Sweep, Task, Track
from cablebench.score.anchors import Anchor, task_hash, write_anchors

ENTRANTS = {  # name: (class, share of the open loop's error that is left, effort, environment steps, trials, samples)
    "open-loop": ("nominal", 1.0, 1.0, 0, 0, 0),
    "pid": ("model-free", 0.34, 1.3, 0, 40, 0),
    "mrac-g9": ("nominal", 0.26, 1.25, 0, 40, 0),
    "mrac-g22": ("nominal", 0.14, 1.2, 0, 40, 0),
    "ppo": ("model-free", 0.2, 1.6, 400_000, 40, 0),
    "oracle": ("oracle", 0.05, 1.1, 0, 0, 0),
}


def made_protocol(**changes) -> Protocol:
    """Two tasks of each mechanism, a nominal and a randomised track, a small stress track."""
    tasks = tuple(
        Task(f"cable_envs/{name}-v0")
        for name in (
            "CableHole-Position-Step",
            "CableHole-Position-Sine",
            "PulleyCircuit-Position-Step",
            "PulleyCircuit-Position-Sine",
        )
    )
    stress = Sweep(
        "friction", 0.5, 2.0, 5, scale={"CableHole": ("friction_coefficient",), "PulleyCircuit": ("shaft_friction",)}
    )
    return Protocol(
        **{
            "name": "made",
            "title": "A board from made-up records",
            "tasks": tasks,
            "tracks": (Track("nominal"), Track("randomised"), Track("stress", episodes=1, sweeps=(stress,))),
            "train": SeedRange(0, 1000),
            "tune": SeedRange(1000, 1000),
            "test": SeedRange(2000, 1000),
            "episodes": 8,
            "training_seeds": 3,
            "resamples": 400,
            "paper": {"CableHole": "mrac-g22", "PulleyCircuit": "mrac-g22"},
            **changes,
        }
    )


def made_suite_protocol(path, **changes) -> Protocol:
    """`made_protocol` with scores of version 1, between anchors that are written to ``path``."""
    protocol = made_protocol(score_version=1, anchors=str(path), **changes)
    anchors = [
        Anchor(
            t.env, track.name, *((0.2, 0.01) if "Circuit" in t.env else (0.004, 0.0002)),
            "rad" if "Circuit" in t.env else "m", "open-loop", "oracle", 20, 2000, task_hash(t, track), "made up",
        )
        for t in protocol.tasks for track in protocol.tracks
    ]  # fmt: skip
    write_anchors(path, anchors, "made up")
    return protocol


def made_episode(
    task: str, left: float, effort: float, rng: np.random.Generator, gain: float = 1.0, fails: bool = False
) -> Episode:
    """A plausible episode: the output lags the reference by an error that is ``left`` of the open loop's."""
    circuit, step = "Circuit" in task, "Step" in task
    t = 0.01 * np.arange(1, (2500 if circuit else 2000) + 1)
    if step:
        r = np.where(t >= 10, 0.5 if circuit else 0.01, 0.0)
        shape = np.where(t >= 10, np.exp(-(t - 10) / (0.3 + left)) * np.cos(2.0 * (t - 10)) + 0.25 * left, 0.05)
    else:
        w = 2 * np.pi * (0.08 if circuit else 0.17189)
        r = (2.436 if circuit else 0.01) * np.sin(w * t)
        shape = 0.4 * np.sign(np.cos(w * t)) + 0.15 * np.sin(3 * w * t)
    size = (0.5 if circuit else 0.01) * left * gain
    y = r - size * shape + 0.01 * size * rng.standard_normal(len(t))
    u = effort * (49 + 20 * np.sign(np.gradient(r)) + 0.4 * rng.standard_normal(len(t)))
    signals = {"slack_fraction": np.zeros(len(t)), "overload": np.zeros(len(t)), "peak_tension": np.abs(u)}
    if circuit:
        phase = np.ones(len(t)) if step else 1.0 + 2 * (np.abs(np.cos(w * t)) > 0.3) - (np.abs(np.cos(w * t)) > 0.9)
        signals |= {"phase": phase, "tension_drive_top": 50 + 0.5 * u, "tension_drive_bottom": 50 - 0.4 * u}
    else:
        signals |= {"drive_tension": u, "load_tension": np.full(len(t), 49.05)}
    end = len(t) // 3 if fails else len(t)
    cut = {k: v[:end] for k, v in signals.items()}
    return Episode(
        t[:end],
        r[:end],
        y[:end],
        u[:end],
        -np.abs(r - y)[:end],
        np.full(end, 2e-5),
        cut,
        fails,
        0.01,
        len(t),
        "rad" if circuit else "m",
        "rad" if circuit else "N",
        10.0 if step else None,
        0.03 if circuit else 0.001,
    )


def a_record(seed: int = 0, **more) -> dict:
    """A record that a store takes, of an episode that nobody ran."""
    return {
        "schema": 1, "protocol_hash": "0123456789ab", "run": "run", "env_id": "cable_envs/CableHole-Position-Sine-v0",
        "task": "CableHole-Position-Sine", "family": "CableHole", "track": "nominal", "entrant": "somebody",
        "information": "nominal", "training_seed": None, "seed": seed, "output_unit": "m", "command_unit": "N",
        "metrics": {"rmse": 0.001, "failed": 0.0}, "versions": {"cable-envs": "0.1.0"}, "charged": {},
        "replay": "cablebench evaluate --controller somebody", **more,
    }  # fmt: skip


def made_records(protocol: Protocol, store=None, entrants=ENTRANTS) -> list[dict]:
    """One record for each episode of every cell; ppo has 3 training seeds and fails now and then when randomised."""
    records = []
    for cell in protocol.cells(tracks=tuple(t.name for t in protocol.tracks)):
        for number, (name, (information, left, effort, steps, trials, samples)) in enumerate(entrants.items()):
            for training_seed in range(3) if steps else (None,):
                kept = []
                run = f"{cell.key}-{name}-{training_seed}".replace(" ", "-")
                for seed in protocol.seeds(cell.episodes):
                    rng = np.random.default_rng([seed, number, training_seed or 0])
                    common = np.random.default_rng(seed).uniform(0.8, 1.2)
                    spread = 0.25 if cell.track.name == "randomised" else 0.05
                    gain = common * (1 + spread * rng.standard_normal() + (0.3 * (training_seed or 0) if steps else 0))
                    gain *= abs(cell.value or 1.0) ** (0.3 if name in ("oracle",) else 1.2)
                    fails = name == "ppo" and cell.track.name == "randomised" and rng.uniform() < 0.12
                    e = made_episode(cell.task.short, left, effort, rng, abs(gain), fails)
                    kept.append(e)
                    records.append(
                        jsonable(
                            {
                                "protocol_hash": protocol.hash(),
                                "run": run,
                                "env_id": cell.task.env,
                                "task": cell.task.short,
                                "family": cell.task.family,
                                "track": cell.track.name,
                                "sweep": cell.sweep and cell.sweep.name,
                                "sweep_value": cell.value,
                                "sweep_unit": "1",
                                "entrant": name,
                                "information": information,
                                "training_seed": training_seed,
                                "seed": seed,
                                "output_unit": e.output_unit,
                                "command_unit": e.command_unit,
                                "metrics": measure(e),
                                "versions": {"cable-envs": "0.1.0"},
                                "machine": "made up",
                                "replay": f"cablebench evaluate --env {cell.task.env} --controller {name}",
                                "charged": {
                                    "environment_steps": steps,
                                    "tuning_trials": trials,
                                    "identification_samples": samples,
                                },
                            }
                        )
                    )
                if store is not None:
                    order = sorted(kept, key=lambda e: (e.terminated, measure(e)["rmse"]))
                    store.trajectories.keep(
                        run, {"median": order[len(order) // 2].thinned(300), "worst": order[-1].thinned(300)}
                    )
    return records
