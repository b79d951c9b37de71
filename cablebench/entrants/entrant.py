"""Who takes part: a name, an information class, what was charged, and how to make the actor for an environment."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from cable_envs.core.errors import ConfigurationError, require_known
from cable_envs.sim.file_options import KNOWN
from cable_envs.sim.registered import setup_of
from cable_envs.sim.setup import Setup
from cable_envs.sim.tasks import LEVELS
from cablebench.protocol.actors import Actor, ControllerActor, PolicyActor

INFORMATION = ("model-free", "nominal", "identified", "planner", "oracle")
"""What an entrant was told about the rig; entrants are ranked within their class. A planner is told the nominal
parameters and tries its commands in the project's own simulator; of the true rig it knows what is measured."""

BUDGETS = ("environment_steps", "tuning_trials", "identification_samples")
"""What is charged and shown, for one training seed."""

CHOICES = ("action_mode", "observe")
"""The environment options that an entrant may choose: what it observes and what its command is. All others say which
episodes are run and are the protocol's."""


IDEAL: Mapping[str, Any] = {"sensors": "ideal", "preview": True, "sensor_noise": False, "sensor_delay": 0}
"""What an oracle has on the tasks of suite v1 besides: sensors without noise, delay, steps and unknown zero, and the
acceleration of the reference."""


def check_choices(options: Mapping[str, Any], who: str) -> None:
    """Refuse options that an entrant may not choose. Raises ConfigurationError that names the first of them."""
    for name in options:
        if name in KNOWN and name not in CHOICES:
            raise ConfigurationError(
                f"{who}: the option '{name}' is the protocol's; an entrant may only choose {', '.join(CHOICES)}"
            )
    require_known(f"option of {who}", options, CHOICES)


def _sees(setup: Setup, needs: Mapping[str, Any]) -> bool:
    """Whether a task has the sensors that an entrant asks for."""
    level = needs.get("observe")
    return setup.conditions is None or level is None or LEVELS.index(level) <= LEVELS.index(setup.conditions.observe)


IN_NAMES = " ._+-()=,:/@#%"
"""What a name on a board may hold besides letters and digits of any script: nothing that a page, a table, a figure or a
terminal takes for markup."""

LONGEST_NAME = 100


def is_name(text: str) -> bool:
    """Whether a text can be a name on a board."""
    return 0 < len(text) <= LONGEST_NAME and all(c.isalnum() or c in IN_NAMES for c in text)


@dataclass(frozen=True)
class Entrant:
    """One policy to evaluate. Several entrants may share a name: the training seeds of an agent, or gains per task."""

    name: str
    information: str
    make: Callable[[Setup], Actor]
    """actor for an environment with this setup"""
    needs: Callable[[str, Setup], Mapping[str, Any] | None]
    """(env id, setup with the track's options) -> further environment options, or None where it does not enter"""
    arguments: str
    """what the command line needs to name it, for the replay command"""
    training_seed: int | None = None
    charged: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    """whatever decides its behaviour: gains, policy file and its hash, ..."""
    versions: Mapping[str, str] = field(default_factory=dict)
    maker: str = ""
    """key of who handed it in (`cablebench.run.makers`); empty: who keeps the store"""
    sandbox: str = ""
    """what stood around the process of its file (`entrants.sandbox.kinds`); empty: no file of its own is run"""
    trained_on: range = range(0)
    """seeds from which the environments of its training started, as far as they are known"""

    def __post_init__(self) -> None:
        if not is_name(self.name):
            raise ConfigurationError(
                f"{self.name[:LONGEST_NAME]!a} is no name for a board: it may hold 1 to {LONGEST_NAME} letters, "
                f"digits and {IN_NAMES.strip()}"
            )
        require_known("information class", [self.information], INFORMATION)
        require_known("budget", self.charged, BUDGETS)

    @property
    def title(self) -> str:
        """Its name, with the training seed where it has one."""
        return self.name if self.training_seed is None else f"{self.name} (seed {self.training_seed})"

    def entered(self) -> tuple[str, ...]:
        """The ids of the environments that it enters, of all that there are, with their default options."""
        from cable_envs import FIRST_IDS, SUITE_IDS

        return tuple(i for i in FIRST_IDS + SUITE_IDS if self.needs(i, setup_of(i, {})) is not None)

    def enters(self, env_id: str, options: Mapping[str, Any]) -> dict[str, Any] | None:
        """The options of the environment that it enters under a protocol's ``options``; None where it does not enter.

        On tasks of suite v1 an oracle has `IDEAL` sensors where the protocol does not say otherwise, and no other
        entrant more sensors than the level has. Raises ConfigurationError where it asks for what the protocol decides.
        """
        setup = setup_of(env_id, options)
        needs = self.needs(env_id, setup)
        if needs is None:
            return None
        check_choices(needs, f"'{self.title}'")
        if setup.conditions is not None and self.information == "oracle":
            needs = {**{name: value for name, value in IDEAL.items() if name not in options}, **needs}
        elif not _sees(setup, needs):
            return None
        for name, value in needs.items():
            if options.get(name, value) != value:
                raise ConfigurationError(
                    f"'{self.title}' needs {name}={value}; the protocol sets {name}={options[name]} on {env_id}"
                )
        return {**options, **needs}

    def replay(self, protocol: str, env_id: str, track: str) -> str:
        """The command that runs its episodes of a task and track again."""
        return f"cablebench evaluate --protocol {shlex.quote(protocol)} --env {env_id} --track {track} {self.arguments}"


def controller_entrant(
    controller: str | type,
    gains: Mapping[str, float] | None = None,
    charged: Mapping[str, float] | None = None,
    envs: Sequence[str] = (),
) -> Entrant:
    """A reference controller by name, or any class with the interface of `cable_envs.baselines.base.Controller`.

    It is made for the nominal rig, observes the level it declares and is charged what it declares in ``charged``.
    ``envs`` limits it to some environment ids; else it enters wherever it applies.
    Raises ConfigurationError for unknown names.
    """
    from cable_envs.baselines import controller_class

    kind: Any = controller_class(controller) if isinstance(controller, str) else controller
    chosen = dict(gains or {})

    def needs(env_id: str, setup: Setup) -> Mapping[str, Any] | None:
        if envs and env_id not in envs:
            return None
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        return {"observe": kind.levels[setup.plant.name]} if kind.applies(*case) else None

    def make(setup: Setup) -> Actor:
        case = (setup.plant.name, setup.action_mode.name, setup.task.kind)
        return ControllerActor(kind(*case, setup.rig.values, setup.control_period, **chosen), setup)

    arguments = f"--controller {shlex.quote(kind.name)}" + "".join(f" --gain {k}={v:.17g}" for k, v in chosen.items())
    return Entrant(
        kind.name, kind.information, make, needs, arguments,
        charged={**getattr(kind, "charged", {}), **(charged or {})},
        settings={"gains": chosen},
    )  # fmt: skip


def agent_entrant(
    name: str,
    policy: Any,
    env_id: str,
    training_seed: int,
    environment_steps: int,
    options: Mapping[str, Any] | None = None,
    tuning_trials: int = 0,
    information: str = "model-free",
    path: str = "",
    settings: Mapping[str, Any] | None = None,
    versions: Mapping[str, str] | None = None,
    trained_on: range | None = None,
) -> Entrant:
    """One trained policy for one environment id.

    ``policy`` has ``predict(observation, state, episode_start, deterministic)``; ``options`` are environment options
    that shape its observation and action as in training (`CHOICES`); ``path`` is where it is saved, for the
    replay command; ``settings`` should hold a hash of the saved file; ``trained_on`` are the seeds from which the
    environments of the training started (default: the training seed).
    """
    shape = dict(options or {})
    return Entrant(
        name=name,
        information=information,
        make=lambda setup: PolicyActor(policy),
        needs=lambda env, setup: shape if env == env_id else None,
        arguments=f"--policy {shlex.quote(path or name)}",
        training_seed=training_seed,
        charged={"environment_steps": environment_steps, "tuning_trials": tuning_trials},
        settings=dict(settings or {}),
        versions=dict(versions or {}),
        trained_on=range(training_seed, training_seed + 1) if trained_on is None else trained_on,
    )
