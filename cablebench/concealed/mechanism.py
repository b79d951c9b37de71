"""Which rigs are hidden, what may be concealed in them, and who plays on them: a file in configs/concealed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from cable_envs.core.config import config_names, config_path, read_yaml
from cable_envs.core.errors import ConfigurationError, require_known

SCHEMA = "cable-concealed/1"
FOLDER = "concealed"
PROTOCOL = "suite-v1"
"""Whose tasks, anchors and seeds are used: those for tuning are an entrant's, those for testing the track's."""
LAWS = Path(__file__).parent / "laws"
"""Effects of no library: one file each."""


@dataclass(frozen=True)
class Mechanism:
    """One mechanism of the track.

    Attributes
    ----------
    name, title : str
        Its name in files and for people.
    env : str
        Id of the environment of the task.
    preset : str
        The rig that everybody believes in.
    bench : mapping
        ``env``, ``controller``, ``options`` and number of ``records`` with which the hidden rig is recorded.
    controller : mapping
        ``name`` of a controller and ``gains``: a file of configs/controllers.
    adaptive : mapping
        The same of one that learns more of the rig while it runs; empty where there is none.
    agent, memory : mapping
        ``settings``: a file of configs/agents, and ``steps`` of the training.
    believed_off : float
        Standard deviation of the logarithm of the true value of an ``uncertain`` parameter over the believed one.
    uncertain : sequence of str
        Parameters that nobody knows exactly.
    library : mapping of str to (float, float)
        Number of an effect of the library -> least and largest size, drawn evenly in the logarithm.
    outside : mapping of str to mapping
        Law of `LAWS` -> its numbers: ``[low, high]`` evenly in the logarithm, or ``{uniform: [low, high]}``.
    randomised : mapping
        Option ``randomize`` of the environment that the randomised agents train on.
    """

    name: str
    title: str
    env: str
    preset: str
    bench: Mapping[str, Any]
    controller: Mapping[str, str]
    adaptive: Mapping[str, str]
    agent: Mapping[str, Any]
    memory: Mapping[str, Any]
    believed_off: float
    uncertain: Sequence[str]
    library: Mapping[str, Sequence[float]]
    outside: Mapping[str, Mapping[str, Any]]
    randomised: Mapping[str, Any]


def mechanisms() -> tuple[str, ...]:
    """Names of all mechanisms of the track."""
    return tuple(config_names(FOLDER))


def load_mechanism(name: str) -> Mechanism:
    """The mechanism of a file in configs/concealed.

    Parameters
    ----------
    name : str
        As `mechanisms` lists them.

    Returns
    -------
    Mechanism

    Raises
    ------
    ConfigurationError
        Where there is none of the name, or its keys are not those of `Mechanism`.
    """
    require_known("mechanism", [name], mechanisms())
    path = config_path(FOLDER, f"{name}.yaml")
    content = dict(read_yaml(path))
    if content.pop("schema", None) != SCHEMA:
        raise ConfigurationError(f"{path}: expected schema: {SCHEMA}")
    wanted = [f.name for f in fields(Mechanism)]
    require_known(f"key in {path}", content, wanted)
    if lacking := [key for key in wanted if key not in content]:
        raise ConfigurationError(f"{path}: {', '.join(lacking)} missing")
    require_known(f"law in {path}", content["outside"], [file.stem for file in sorted(LAWS.glob("*.py"))])
    return Mechanism(**content)
