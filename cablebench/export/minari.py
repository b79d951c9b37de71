"""Episodes as a Minari dataset (https://minari.farama.org): HDF5 below ``root``, read by ``minari.load_dataset``.

Besides what Minari itself asks for, the dataset's metadata name the observation's channels and the infos with their
units; each episode's metadata hold its seed and the true parameters of its rig. ``recover_environment()`` gives the
environment with the same options: reset with an episode's seed and given its actions, it repeats it to the bit.
"""

import json
import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

import cable_envs
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import require_writable
from cable_envs.core.provenance import versions
from cable_envs.diagnosis.data.writing import staging, undo
from cablebench.entrants.entrant import CHOICES, Entrant
from cablebench.entrants.named import reference_entrants
from cablebench.export.trace import Trace
from cablebench.run.evaluation import core_of, env_id_of, run_episode

ROOT_VARIABLE = "MINARI_DATASETS_PATH"
"""Where Minari looks for datasets; its functions know no argument for it."""

SCORED = 3
"""Episodes of the open loop and of the oracle for the scores of a dataset."""
_EXAMPLE = "cable/CableHole-Position-Sine/pid-v0"


def check_dataset_id(dataset_id: str, root: Path) -> None:
    """ConfigurationError unless ``dataset_id`` is like ``cable/NAME-v0`` and new, and ``root`` can be written to."""
    import h5py  # noqa: F401 (Minari's own message for a missing h5py would name another extra)
    from minari.dataset.minari_dataset import parse_dataset_id

    try:
        parse_dataset_id(dataset_id)
    except (ValueError, TypeError) as error:  # TypeError: Minari 0.5 turns a missing version into int(None)
        raise ConfigurationError(
            f"dataset id '{dataset_id}': expected NAMESPACE/NAME-vN, such as {_EXAMPLE}"
        ) from error
    require_writable(root)
    undo(root)
    if (root / dataset_id).exists():
        raise ConfigurationError(
            f"{root / dataset_id} exists: choose another folder, or a dataset id with a higher version"
        )


def write_dataset(
    traces: Sequence[Trace],
    env: gym.Env,
    entrant: Entrant,
    root: Path,
    dataset_id: str,
    *,
    author: str | None = None,
    author_email: str | None = None,
    code_permalink: str | None = None,
    beside: Callable[[Path], None] | None = None,
) -> Path:
    """Write ``traces`` of ``env`` as ``dataset_id`` below ``root``; returns its folder. A failure leaves nothing there.

    ``beside`` is given the folder before it is put into its place, for further files.
    Load it with ``MINARI_DATASETS_PATH=root`` in the process' environment. Raises ConfigurationError for a bad id, and
    where the dataset exists.
    """
    check_dataset_id(dataset_id, root)
    import minari
    from minari import create_dataset_from_buffers
    from minari.data_collector import EpisodeBuffer

    buffers = [
        EpisodeBuffer(
            seed=t.seed,
            observations=t.observations,
            actions=t.actions,
            rewards=t.episode.reward,
            terminations=t.terminations,
            truncations=t.truncations,
            infos=dict(t.infos),
        )
        for t in traces
    ]
    with staging(root) as stage:
        with _datasets_in(stage), warnings.catch_warnings():
            # Minari wants an author, an address and a link for what is uploaded; whoever exports may have none to give
            warnings.filterwarnings("ignore", r"`(author|author_email|code_permalink)` is set to None", UserWarning)
            dataset = create_dataset_from_buffers(
                dataset_id, buffers, env=env, eval_env=env.spec, algorithm_name=entrant.title,
                author=author, author_email=author_email, code_permalink=code_permalink,
                description=_description(env, entrant, traces),
                requirements=[f"cable-envs>={cable_envs.__version__}", f"minari>={minari.__version__}"],
                **reference_scores(env, [t.seed for t in traces[:SCORED]]),
            )  # fmt: skip
            dataset.storage.update_metadata(_about(env, entrant))
            dataset.storage.update_episode_metadata([{"rig": json.dumps(dict(t.rig))} for t in traces])
        if beside is not None:
            beside(stage / dataset_id)
        _move(stage, root, dataset_id)
    return root / dataset_id


def _move(stage: Path, root: Path, dataset_id: str) -> None:
    """The dataset to its place in one step, after what describes the namespaces above it."""
    (root / dataset_id).parent.mkdir(parents=True, exist_ok=True)
    for above in Path(dataset_id).parents:
        for file in (stage / above).glob("*.json"):
            if not (root / above / file.name).exists():
                os.replace(file, root / above / file.name)
    os.replace(stage / dataset_id, root / dataset_id)


def reference_scores(env: gym.Env, seeds: Sequence[int]) -> dict[str, float | int]:
    """What `minari.get_normalized_score` takes for 0 and for 1: mean returns of the open loop and of the oracle.

    Parameters
    ----------
    env : gymnasium.Env
        The environment of the dataset; they run on copies with its options, the oracle with all observations.
    seeds : sequence of int
        Of the episodes.

    Returns
    -------
    dict
        ``ref_min_score``, ``ref_max_score`` and ``num_episodes_average_score``; empty for a task that has no oracle.
    """
    env_id, given = env_id_of(env), dict(env.spec.kwargs) if env.spec else {}
    chosen = ("task", "reference", "render_mode", "render_theme", *CHOICES)
    options = {name: value for name, value in given.items() if name not in chosen}
    returns = {}
    for entrant in reference_entrants():
        if entrant.name not in ("open-loop", "oracle"):
            continue
        own = entrant.enters(env_id, options)
        if own is not None:
            with gym.make(env_id, **own) as made:
                actor = entrant.make(core_of(made).setup)
                runs = [run_episode(made, actor, seed=seed) for seed in seeds]
            returns[entrant.name] = float(np.mean([np.sum(episode.reward) for episode in runs]))
    if set(returns) != {"open-loop", "oracle"}:
        return {}
    return {
        "ref_min_score": returns["open-loop"], "ref_max_score": returns["oracle"],
        "num_episodes_average_score": len(seeds),
    }  # fmt: skip


def load(root: Path, dataset_id: str) -> Any:
    """``minari.load_dataset`` for a dataset below ``root``."""
    import minari

    with _datasets_in(root):
        return minari.load_dataset(dataset_id)


@contextmanager
def _datasets_in(root: Path) -> Iterator[None]:
    before = os.environ.get(ROOT_VARIABLE)
    os.environ[ROOT_VARIABLE] = str(root.absolute())  # Minari 0.5 does not find what it wrote below a relative one
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT_VARIABLE]
        else:
            os.environ[ROOT_VARIABLE] = before


def _description(env: gym.Env, entrant: Entrant, traces: Sequence[Trace]) -> str:
    setup = core_of(env).setup
    failed = sum(not t.episode.complete for t in traces)
    return (
        f"{len(traces)} episodes of {entrant.title} on {env_id_of(env)} (rig {setup.rig.name}), {failed} of them "
        "cut short. Observations are SI values over the scale of their channel; actions in [-1, 1] are linear over the "
        "range of the command."
    )


def _second(setup: Any) -> dict[str, Any]:
    """What a second action is."""
    second = setup.action_mode.commands[1]
    return {"name": second.name, "unit": second.unit, "low": setup.ranges[1][0], "high": setup.ranges[1][1]}


def _about(env: gym.Env, entrant: Entrant) -> dict[str, Any]:
    """Metadata beyond Minari's own, JSON types only."""
    setup = core_of(env).setup
    units = {s.name: s.unit for s in setup.plant.signals}
    own = {"time": "s", "reference": setup.output_unit, "output": setup.output_unit, "error": setup.output_unit,
           "command": setup.action_mode.unit, "overload": "1"}  # fmt: skip
    return {
        "channels": [{"name": c.name, "unit": c.unit, "scale": c.scale} for c in setup.channels],
        "info_units": {**units, **own},
        "command": {"unit": setup.action_mode.unit, "low": setup.low, "high": setup.high},
        **({} if len(setup.ranges) == 1 else {"second_command": _second(setup)}),
        "entrant": {"name": entrant.name, "information": entrant.information, "training_seed": entrant.training_seed,
                    "charged": dict(entrant.charged)},
        "versions": versions(),
    }  # fmt: skip
