"""The steps of `cablebench pays`. Each keeps its result in the folder and is skipped where that is there already."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cable_envs.config import read_yaml
from cable_envs.errors import ConfigurationError
from cablebench import pays
from cablebench.entrants import controller_entrant
from cablebench.evaluate import setup_of
from cablebench.jobs import Job, open_backend
from cablebench.pays import AGENT, CONTROLLER, ENV, LEARNERS, NOMINAL_RIG, SIMULATORS, Study
from cablebench.protocol import load_protocol
from cablebench.store import jsonable, write_atomic

Progress = Callable[[str, int, int, str], None]

MOTIONS = (
    {"kind": "sine", "amplitude": 2.0, "frequency": 0.12},
    {"kind": "multisine", "amplitude": 1.8, "frequency": 0.1},
    {"kind": "multisine", "amplitude": 1.4, "frequency": 0.08},
)
"""References of the recordings, the last held out: other motions than the task's."""


def begin(study: Study, out: Path) -> None:
    """Write what is asked to ``out``/study.json. Raises ConfigurationError where another study was begun there."""
    file = out / "study.json"
    asked = {"schema": pays.SCHEMA, "hash": study.hash(), **asdict(study)}
    if file.exists():
        begun = json.loads(file.read_text(encoding="utf-8"))
        if begun.get("hash") != study.hash():
            raise ConfigurationError(f"{out} holds a study with other settings: choose another folder")
        return
    write_atomic(file, json.dumps(jsonable(asked), indent=1) + "\n")


def augmented(study: Study, out: Path, tell: Callable[[str], None]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(the diagnosis as JSON, content of augmented.yaml) of recordings of the hidden rig."""
    from cablebench.export.concealed import write_concealed
    from cablebench.export.recording import FILE
    from diagnosis.engine import diagnose

    recording, folder = out / "recording", out / "diagnosis"
    if not (recording / FILE).exists():
        tell("recording the hidden rig")
        entrant = controller_entrant(CONTROLLER, {"kp": 0.0, "ki": 0.0, "kd": 0.0})
        options = {**study.hidden_options(), "duration": study.record_seconds}
        write_concealed(ENV, options, MOTIONS, entrant, NOMINAL_RIG, recording, seed=study.seeds[0])
    if not (folder / "augmented.yaml").exists():
        found = diagnose(recording, seed=study.seeds[0], out=folder, tell=lambda text: tell(f"diagnosis: {text}"))
        found.write(folder)
    verdict = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    return verdict, dict(read_yaml(folder / "augmented.yaml"))


def tuned_gains(study: Study, out: Path, simulator: str, rig: Mapping[str, Any], seed: int, progress: Progress) -> Any:
    """The controller's gains after the study's trials on a simulator."""
    from baselines import controller_class
    from cablebench.tuning import Search, best, tune
    from cablebench.tuning_space import gain_space

    options = study.simulator_options(simulator, rig)
    setup = setup_of(ENV, options)
    table = controller_class(CONTROLLER).parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    tuning = load_protocol("quick").tune
    seeds = [tuning.seed(100 * seed + k) for k in range(study.tuning_episodes)]
    name = f"{CONTROLLER}, {simulator}, seed {seed}"

    def job(number: int, gains: Mapping[str, Any]) -> Job:
        return Job(f"{name}, trial {number}", pays.trial, {"gains": dict(gains), "options": options, "seeds": seeds})

    search = Search(
        name=name, space=gain_space(table), start={p.name: p.default for p in table}, job=job,
        about={"study": study.hash(), "simulator": simulator}, seed=seed,
    )  # fmt: skip
    file = out / "tuning" / f"{simulator}-{seed}.sqlite"
    with open_backend("local", 1) as backend:
        trials = tune(file, search, study.trials, backend, lambda *now: progress(name, *now))
    return dict(best(trials).values)


def trained(study: Study, out: Path, simulator: str, rig: Mapping[str, Any], seed: int, progress: Progress) -> Any:
    """The agent's policy after the study's steps on a simulator, without randomisation: which rig it is counts."""
    from agents.settings import load_settings
    from agents.train import Interrupted, train

    options = {**study.simulator_options(simulator, rig), "randomize": False}
    settings = load_settings(AGENT, ENV, study.steps, options)
    name = f"{AGENT}, {simulator}, seed {seed}"
    folder = out / "agents" / f"{simulator}-{seed}"
    try:
        return train(settings, seed, folder, resume="auto", progress=lambda *now: progress(name, *now))
    except Interrupted as stop:  # it is saved
        raise KeyboardInterrupt from stop


def scored(
    study: Study, out: Path, learner: str, simulator: str, rig: Any, seed: int, progress: Progress
) -> list[float]:
    """Errors on the hidden rig of a learner from a simulator, rad; makes what is missing first."""
    from cablebench.actors import PolicyActor

    file = out / "scores" / f"{learner}-{simulator}-{seed}.json"
    if file.exists():
        return json.loads(file.read_text(encoding="utf-8"))
    make = tuned_gains if learner == CONTROLLER else trained
    made = make(study, out, simulator, rig, seed, progress)
    if learner == CONTROLLER:
        believed = setup_of(ENV, study.simulator_options(simulator, rig))

        def actor(setup: Any) -> Any:
            return pays.controller_actor(made, believed, setup)
    else:

        def actor(setup: Any) -> Any:
            return PolicyActor(made)

    test = load_protocol("quick").seeds(study.episodes)
    found = pays.errors(actor, study.hidden_options(), test)
    write_atomic(file, json.dumps(found) + "\n")
    return found


def run(study: Study, out: Path, quick: bool, tell: Callable[[str], None], progress: Progress) -> dict[str, Any]:
    """All of it; writes ``out``/pays.json and ``out``/pays.md and returns the former. The same call goes on."""
    begin(study, out)
    verdict, rig = augmented(study, out, tell)
    tell(f"diagnosis: {verdict['verdict']}, {', '.join(e['name'] for e in verdict['effects']) or 'no effect'}")
    scores: dict[str, dict[str, list[list[float]]]] = {learner: {s: [] for s in SIMULATORS} for learner in LEARNERS}
    for seed in study.seeds:
        for learner in LEARNERS:
            for simulator in SIMULATORS:
                tell(f"{learner} on the {simulator} simulator, seed {seed}")
                scores[learner][simulator].append(scored(study, out, learner, simulator, rig, seed, progress))
    result = {
        "schema": pays.SCHEMA, "command": pays.command(study, quick), "hidden": study.hidden,
        "diagnosis": {"verdict": verdict["verdict"], "effects": verdict["effects"]},
        "seeds": study.seeds, "episodes": study.episodes,
        "budget": {"trials": study.trials, "steps": study.steps, "tuning_episodes": study.tuning_episodes},
        "summary": pays.summary(scores), "scores": scores,
    }  # fmt: skip
    result = json.loads(json.dumps(jsonable(result)))
    write_atomic(out / "pays.json", json.dumps(result, indent=1, allow_nan=False) + "\n")
    write_atomic(out / "pays.md", pays.page(result))
    return result
