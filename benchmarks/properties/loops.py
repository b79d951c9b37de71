"""Reference controllers on random rigs: how much the episode changes with far shorter integration steps."""

from collections.abc import Iterator

import gymnasium as gym
import numpy as np

from benchmarks.properties.measures import MOST, compared, nudged, yardstick
from benchmarks.properties.rigs import Box, drawn
from cable_envs.sim.registered import setup_of
from cable_envs.sim.rigs import Rig, load_rig
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import load_task
from cablebench.entrants.entrant import Entrant
from cablebench.entrants.named import reference_entrants
from cablebench.protocol.episode import Episode
from cablebench.run.evaluation import run_episode

TASKS = (
    "CableHole-Position", "CableHole-Tension", "TendonSheath-Position", "TendonSheath-Tension",
    "PulleyCircuit-Position", "PulleyCircuit-Torque",
)  # fmt: skip
SECONDS = 6.0
"""Length of an episode: more than a period of every task's sine, or a half of the circuit's."""

ROUNDING = 1e-9
"""What moves less, m or rad, does not move."""


def env_of(task: str) -> str:
    """The id of a task whose reference moves all the time."""
    return f"cable_envs/{task}-Sine-v1"


def cases() -> Iterator[tuple[str, str, str]]:
    """(task, action mode, controller), all that there are."""
    for task in TASKS:
        plant = setup_of(env_of(task), {}).plant
        for mode in plant.action_modes:
            setup = setup_of(env_of(task), {"action_mode": mode.name})
            for entrant in reference_entrants():
                if entrant.needs(env_of(task), setup) is not None:
                    yield task, mode.name, entrant.name


def rigs(task: str, box: Box, count: int, seed: int) -> Iterator[Rig]:
    """Random rigs about that of a task."""
    rig = load_rig(load_task(task).rigs.get("v1", load_task(task).rig))
    plant = rig.simulated_by()
    values = drawn(plant, rig.column(plant)[: len(plant.parameters), 0], box, count, np.random.default_rng(seed))
    for column in values.T:
        yield rig.replace(dict(zip(plant.parameters.names, column.tolist(), strict=True)))


def episode(setup: Setup, entrant: Entrant, env_id: str, options: dict, finer: int) -> Episode:
    """An episode in which a control period has ``finer`` times as many integration steps as the environment chooses."""
    needs = {**options, **(entrant.needs(env_id, setup) or {}), "substeps": setup.substeps * finer}
    env = gym.make(env_id, **needs)
    return run_episode(env, entrant.make(env.unwrapped.setup), seed=1)  # type: ignore[attr-defined]


def loop_error(task: str, mode: str, controller: str, rig: Rig, period: float, finer: int) -> tuple[float, bool]:
    """(worst signal's difference to an episode with far shorter steps, whether the rig determines the episode).

    Raises ConfigurationError where the rig is refused. `differs` and `measures.nudged` say what the two are.
    """
    env_id, entrant = env_of(task), reference_entrants((controller,))[0]
    options = {"action_mode": mode, "duration": SECONDS, "control_period": period}
    setup = setup_of(env_id, {"rig": rig, **options})
    coarse, fine = (episode(setup, entrant, env_id, {"rig": rig, **options}, times) for times in (1, finer))
    error = differs(setup, coarse, fine)
    if error <= MOST:
        return error, True
    plant = rig.simulated_by()
    for other in nudged(plant, rig.column(plant)[: len(plant.parameters)]):
        others = rig.replace(dict(zip(plant.parameters.names, other[:, 0].tolist(), strict=True)))
        if differs(setup, episode(setup, entrant, env_id, {"rig": others, **options}, finer), fine) > MOST:
            return error, False
    return error, True


def differs(setup: Setup, coarse: Episode, fine: Episode) -> float:
    """Worst signal's difference (root mean square) between two episodes, as far as both go.

    Positions relative to how much they move, if that is more than rounding; tensions and torques relative to those at
    the drive.
    """
    many, worst = min(len(coarse.time), len(fine.time)), 0.0
    for signal in setup.plant.signals:
        name = signal.name
        if not compared(name) or name not in fine.signals:
            continue
        a, b = coarse.signals[name][:many], fine.signals[name][:many]
        size = b - b.mean() if signal.unit in ("m", "rad") else fine.signals[yardstick(setup.plant, signal)][:many]
        whole = _rms(size)
        worst = max(worst, _rms(a - b) / whole) if whole > ROUNDING else worst
    return worst


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
