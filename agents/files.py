"""Where agents lie: settings by name, trained policies by path.

It is asked before torch is imported, which takes seconds.
"""

from pathlib import Path

from cable_envs.core.config import config_path, config_root
from cable_envs.core.errors import ConfigurationError, require_known

POLICY, CHECKPOINT = "policy.zip", "checkpoint.pt"
"""Names of the files in a training's folder."""


def agent_names() -> tuple[str, ...]:
    """Names of the files in configs/agents/, in alphabetical order."""
    return tuple(sorted(p.stem for p in (config_root() / "agents").glob("*.yaml")))


def settings_file(algo: str) -> Path:
    """The YAML file of an agent.

    Parameters
    ----------
    algo : str
        Name of a file in configs/agents (`agent_names`), or path of a YAML file.

    Returns
    -------
    Path

    Raises
    ------
    ConfigurationError
        For unknown agents, with the nearest, and where there is no file.
    """
    if algo.endswith((".yaml", ".yml")):
        if not Path(algo).is_file():
            raise ConfigurationError(f"no settings file {algo}")
        return Path(algo)
    require_known("algorithm", [algo], agent_names())
    return config_path("agents", f"{algo}.yaml")


def policy_file(path: str | Path) -> Path:
    """The file of a policy.

    Parameters
    ----------
    path : str or Path
        The file, or the folder of a training.

    Returns
    -------
    Path
        A file that is there: ``path`` itself, or policy.zip in it.

    Raises
    ------
    ConfigurationError
        Where there is none.
    """
    given = Path(path)
    file = given / POLICY if given.is_dir() else given
    if not file.is_file():
        raise ConfigurationError(
            f"no policy at {path}; `cablebench train` writes {POLICY} to the folder named by --out"
        )
    return file
