"""How the rows of the concealed track come to their controllers and policies.

A controller is told a rig, and its gains are tuned on a simulator; an agent is trained on one. The simulators are the
believed one, the one that a diagnosis of the recordings corrected, and the true one.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError
from cablebench.concealed.given import Given, MakeActor, episode_metrics
from cablebench.concealed.mechanism import PROTOCOL
from cablebench.concealed.scores import score_of
from cablebench.entrants.controller_files import find_controller_file, load_controller_file
from cablebench.jobs import Job, open_backend
from cablebench.protocol.actors import PolicyActor, controller_actor
from cablebench.protocol.files import load_protocol
from cablebench.tune.space import gain_space
from cablebench.tune.study import Search, best, tune

TRIALS = 24
"""Of a tuning on a simulator, each with `EPISODES` episodes."""
EPISODES = 2


def shipped_gains(name: str, env_id: str) -> dict[str, float]:
    """The gains of a file of configs/controllers for an environment."""
    return dict(load_controller_file(find_controller_file(name)).gains[env_id])


def controller(given: Given, name: str, gains: Mapping[str, float], told: Mapping[str, Any]) -> MakeActor:
    """A reference controller that is told the rig of a simulator.

    Parameters
    ----------
    given : Given
    name : str
        Of the controller (`cable_envs.baselines`).
    gains : mapping
        By name; the controller's defaults for what is missing.
    told : mapping
        Environment options of the simulator whose rig it takes for the true one.

    Returns
    -------
    callable
        Its actor for a setup.
    """
    believed = given.setup(told)
    return lambda acting: controller_actor(name, gains, believed, acting)


def tuned(given: Given, name: str, simulator: Mapping[str, Any], label: str) -> MakeActor:
    """The mechanism's controller, told the rig of a simulator and tuned on it, beginning with its shipped gains.

    Parameters
    ----------
    given : Given
    name : str
        Of the controller.
    simulator : mapping
        Environment options.
    label : str
        Of what is kept of the trials in the rig's folder.

    Returns
    -------
    callable
    """
    start = shipped_gains(given.mechanism.controller["gains"], given.mechanism.env)
    seeds = [load_protocol(PROTOCOL).tune.seed(k) for k in range(EPISODES)]

    def loss(gains: Mapping[str, float]) -> float:
        found = episode_metrics(given.mechanism.env, simulator, controller(given, name, gains, simulator), seeds)
        return -sum(score_of(given.mechanism.env, m) for m in found) / len(found)

    return controller(given, name, _searched(given, name, start, loss, TRIALS, label), simulator)


def _searched(
    given: Given, name: str, start: Mapping[str, float], loss: Any, trials: int, label: str, batch: int = 4
) -> dict[str, Any]:
    """The gains with the least loss of some trials, the first of them the start."""
    from cable_envs.baselines import controller_class

    setup = given.setup()
    table = controller_class(name).parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    search = Search(
        name=label, space=gain_space(table), start={p.name: start.get(p.name, p.default) for p in table},
        job=lambda number, gains: Job(f"{label} {number}", lambda context: loss(gains), {}),
        about={"rig": str(given.folder.name), "label": label}, seed=given.seed, batch=batch,
    )  # fmt: skip
    file = given.folder / "trials" / f"{label}.sqlite"
    with open_backend("local", 1) as backend:
        found = tune(file, search, trials, backend, lambda done, total, text: given.tell(f"{label}: {done}/{total}"))
    return dict(best(found[:trials]).values)


def trained(
    given: Given, settings: Mapping[str, Any], simulator: Mapping[str, Any], folder: Path, randomize: Any = False
) -> MakeActor:
    """A policy trained on a simulator, from nothing.

    Parameters
    ----------
    given : Given
    settings : mapping
        ``settings``: a file of configs/agents; ``steps`` of the training.
    simulator : mapping
        Environment options.
    folder : Path
        Where the policy is kept; one that is complete is taken.
    randomize : mapping or bool
        The environment's option of the name.

    Returns
    -------
    callable
    """
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import train

    env = given.mechanism.env
    options = {**simulator, "randomize": randomize}
    asked = load_settings(settings["settings"], env, int(settings["steps"]), options)
    asked = replace(asked, curriculum={} if not randomize else asked.curriculum)
    policy = train(
        asked, given.seed, folder, resume="auto", checkpoint_every=600.0,
        progress=lambda done, total, text: given.tell(f"training: {done}/{total}, {text}"),
    )  # fmt: skip
    return lambda setup: PolicyActor(policy)


def corrected(given: Given) -> dict[str, Any]:
    """Environment options of the simulator that `cablebench diagnose` corrected, from the recordings of the rig.

    Returns
    -------
    dict
        With ``rig``, the content of augmented.yaml. Where the diagnosis names no effect it is the refitted rig, and
        where the corrected rig cannot be simulated, such as one whose refit leaves no inertia, the believed one.
    """
    from cable_envs.diagnosis.engine import diagnose

    folder = given.folder / "diagnosis"
    if not (folder / "augmented.yaml").is_file():
        diagnose(
            given.recording, seed=given.seed, out=folder, tell=lambda text: given.tell(f"diagnosis: {text}")
        ).write(folder)
    found = {"rig": dict(read_yaml(folder / "augmented.yaml"))}
    try:
        given.setup(found)
    except ConfigurationError as error:
        given.tell(f"the corrected rig cannot be simulated, and the believed one is taken: {error}")
        return given.believed
    return found


def truth(given: Given) -> dict[str, Any]:
    """Environment options of the hidden rig: for oracles alone."""
    return dict(given.episodes.true_options)


def nominal_controller(given: Given) -> MakeActor:
    """The mechanism's controller with its shipped gains, which were found on the believed rig."""
    name, gains = given.mechanism.controller["name"], given.mechanism.controller["gains"]
    return controller(given, name, shipped_gains(gains, given.mechanism.env), given.believed)


def adaptive_controller(given: Given) -> MakeActor:
    """The mechanism's adaptive controller with its shipped gains."""
    name, gains = given.mechanism.adaptive["name"], given.mechanism.adaptive["gains"]
    return controller(given, name, shipped_gains(gains, given.mechanism.env), given.believed)


def diagnosed_controller(given: Given) -> MakeActor:
    """The mechanism's controller, told the diagnosed rig and tuned on its simulator."""
    return tuned(given, given.mechanism.controller["name"], corrected(given), "diagnosed")


def oracle_controller(given: Given) -> MakeActor:
    """The mechanism's controller, told the true rig and tuned on its simulator."""
    return tuned(given, given.mechanism.controller["name"], truth(given), "oracle")


def tuned_on_the_rig(given: Given, count: int) -> MakeActor:
    """The mechanism's controller with the best of ``count`` sets of gains, each tried in one episode on the rig.

    More episodes go on with the sets that fewer have tried: all numbers of episodes are one study.
    """
    name = given.mechanism.controller["name"]
    start = shipped_gains(given.mechanism.controller["gains"], given.mechanism.env)

    def loss(gains: Mapping[str, float]) -> float:
        return -score_of(given.mechanism.env, given.episodes.run(controller(given, name, gains, given.believed)))

    return controller(given, name, _searched(given, name, start, loss, count, "on-the-rig", batch=1), given.believed)


def nominal_agent(given: Given) -> MakeActor:
    """An agent trained once, on the believed rig."""
    return trained(given, given.mechanism.agent, given.believed, given.shared / "nominal-agent")


def randomised_agent(given: Given) -> MakeActor:
    """An agent trained once, on rigs and effects drawn for every episode."""
    folder = given.shared / "randomised-agent"
    return trained(given, given.mechanism.agent, given.believed, folder, given.mechanism.randomised)


def memory_agent(given: Given) -> MakeActor:
    """An agent with a memory, trained once, on rigs and effects drawn for every episode."""
    folder = given.shared / "memory-agent"
    return trained(given, given.mechanism.memory, given.believed, folder, given.mechanism.randomised)


def diagnosed_agent(given: Given) -> MakeActor:
    """An agent trained on the corrected simulator."""
    return trained(given, given.mechanism.agent, corrected(given), given.folder / "diagnosed-agent")


def oracle_agent(given: Given) -> MakeActor:
    """An agent trained on the true simulator."""
    return trained(given, given.mechanism.agent, truth(given), given.folder / "oracle-agent")
