"""The steps of `cablebench retrain-study`. Each keeps its result in the folder; what is there already is skipped."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

from cable_envs.core.config import read_yaml
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import json_text, jsonable, packed_json, write_atomic
from cable_envs.sim.registered import setup_of
from cablebench.jobs import Job, open_backend
from cablebench.pays import scores as pays
from cablebench.pays.scores import SIMULATORS, Study
from cablebench.protocol.files import load_protocol

Progress = Callable[[str, int, int, str], None]
RECORDING_SEED = 0
"""Of the recordings' noise and of the draws behind the diagnosis: there is one recording, whatever the seeds."""


def begin(study: Study, out: Path) -> None:
    """Write what is asked to ``out``/study.json. Raises ConfigurationError where another study was begun there."""
    file = out / "study.json"
    asked = {"schema": pays.SCHEMA, "hash": study.hash(), **study.asked()}
    if file.exists():
        begun = json.loads(file.read_text(encoding="utf-8"))
        if begun.get("hash") != study.hash():
            raise ConfigurationError(f"{out} holds a study with other settings: choose another folder")
        return
    write_atomic(file, json_text(asked))


def recorded(study: Study, folder: Path) -> Path:
    """Record the hidden rig into ``folder``; the recording's file."""
    from cablebench.export.concealed import write_concealed

    bench, hidden = study.bench, setup_of(study.bench.env, study.hidden_options())
    return write_concealed(hidden, bench.motions, bench.preset, folder, study.record_seconds, RECORDING_SEED)


def augmented(study: Study, out: Path, tell: Callable[[str], None]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(the diagnosis as JSON, content of augmented.yaml) of recordings of the hidden rig."""
    from cable_envs.diagnosis.data.writing import FILE
    from cable_envs.diagnosis.engine import diagnose

    recording, folder = out / "recording", out / "diagnosis"
    if not (recording / FILE).exists():
        tell(f"recording the hidden {study.rig}")
        recorded(study, recording)
    if not (folder / "augmented.yaml").exists():
        found = diagnose(recording, seed=RECORDING_SEED, out=folder, tell=lambda text: tell(f"diagnosis: {text}"))
        found.write(folder)
    verdict = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    return verdict, dict(read_yaml(folder / "augmented.yaml"))


def tuned_gains(study: Study, out: Path, simulator: str, rig: Mapping[str, Any], seed: int, progress: Progress) -> Any:
    """The controller's gains after the study's trials on a simulator."""
    from cable_envs.baselines import controller_class
    from cablebench.tune.space import gain_space
    from cablebench.tune.study import Search, best, tune

    options, controller = study.simulator_options(simulator, rig), study.bench.controller
    setup = setup_of(study.bench.env, options)
    table = controller_class(controller).parameters_for(setup.plant.name, setup.action_mode.name, setup.task.kind)
    tuning = load_protocol("quick").tune
    seeds = [tuning.seed(100 * seed + k) for k in range(study.tuning_episodes)]
    name = f"{controller}, {simulator}, seed {seed}"

    def job(number: int, gains: Mapping[str, Any]) -> Job:
        arguments = {"rig": study.rig, "gains": dict(gains), "options": options, "seeds": seeds}
        return Job(f"{name}, trial {number}", pays.trial, arguments)

    search = Search(
        name=name, space=gain_space(table), start={p.name: p.default for p in table}, job=job,
        about={"study": study.hash(), "simulator": simulator}, seed=seed,
    )  # fmt: skip
    file = out / "tuning" / f"{simulator}-{seed}.sqlite"
    with open_backend("local", 1) as backend:
        trials = tune(file, search, study.trials, backend, lambda *now: progress(name, *now))
    return dict(best(trials).values)


def trained(study: Study, out: Path, simulator: str, rig: Mapping[str, Any], seed: int, progress: Progress) -> Any:
    """The agent's policy after the study's steps on a simulator, without randomisation: which rig it is counts.

    A loaded policy gives its controller the task's own rig; here it keeps the one that it was trained with.
    """
    from cable_envs.agents.settings import load_settings
    from cable_envs.agents.train import Interrupted, train

    bench = study.bench
    options = {**study.simulator_options(simulator, rig), "randomize": False}
    settings = load_settings(bench.agent, bench.env, study.steps, options)
    name = f"{bench.agent}, {simulator}, seed {seed}"
    folder = out / "agents" / f"{simulator}-{seed}"
    try:
        policy = train(settings, seed, folder, resume="auto", progress=lambda *now: progress(name, *now))
    except Interrupted as stop:  # it is saved
        raise KeyboardInterrupt from stop
    return replace(policy, setup=setup_of(bench.env, study.simulator_options(simulator, rig)))


def scored(
    study: Study, out: Path, learner: str, simulator: str, rig: Any, seed: int, progress: Progress
) -> list[float]:
    """Errors on the hidden rig of a learner from a simulator, SI; makes what is missing first."""
    from cablebench.protocol.actors import PolicyActor, controller_actor

    file = out / "scores" / f"{learner}-{simulator}-{seed}.json"
    if file.exists():
        return json.loads(file.read_text(encoding="utf-8"))
    bench = study.bench
    make = tuned_gains if learner == bench.controller else trained
    made = make(study, out, simulator, rig, seed, progress)
    if learner == bench.controller:
        believed = setup_of(bench.env, study.simulator_options(simulator, rig))

        def actor(setup: Any) -> Any:
            return controller_actor(learner, made, believed, setup)
    else:

        def actor(setup: Any) -> Any:
            return PolicyActor(made)

    test = load_protocol("quick").seeds(study.episodes)
    found = pays.errors(bench.env, actor, study.hidden_options(), test)
    write_atomic(file, json.dumps(found) + "\n")
    return found


def run(
    studies: Sequence[Study], out: Path, quick: bool, tell: Callable[[str], None], progress: Progress
) -> dict[str, Any]:
    """All of it, seed after seed, for studies that differ in their rigs only; the same call goes on.

    Writes pays.json.xz, pays.md and pays.svg to ``out`` and returns the first; each rig has a folder with all it made.
    """
    from cablebench.pays.page import FIGURE, command, figure, page

    answers: dict[str, Any] = {}
    scores: dict[str, Any] = {}
    for study in studies:
        begin(study, out / study.rig)
        answers[study.rig] = augmented(study, out / study.rig, tell)
        names = ", ".join(e["name"] for e in answers[study.rig][0]["effects"]) or "no effect"
        tell(f"diagnosis of the {study.rig}: {answers[study.rig][0]['verdict']}, {names}")
        scores[study.rig] = {learner: {s: [] for s in SIMULATORS} for learner in study.learners}
    first = studies[0]
    for seed, study in product(first.seeds, studies):  # seed after seed: a stopped study has whole ones
        for learner, simulator in product(study.learners, SIMULATORS):
            tell(f"{learner} on the {simulator} {study.rig}, seed {seed}")
            rig = answers[study.rig][1]
            found = scored(study, out / study.rig, learner, simulator, rig, seed, progress)
            scores[study.rig][learner][simulator].append(found)
    rigs = {
        study.rig: {
            "hidden": study.effects,
            "diagnosis": {key: answers[study.rig][0][key] for key in ("verdict", "effects")},
            "summary": pays.summary(scores[study.rig]),
            "scores": scores[study.rig],
        }
        for study in studies
    }
    result = {
        "schema": pays.SCHEMA, "command": command(studies, quick), "seeds": first.seeds, "episodes": first.episodes,
        "budget": {"trials": first.trials, "steps": first.steps, "tuning_episodes": first.tuning_episodes},
        "rigs": rigs,
    }  # fmt: skip
    result = json.loads(json.dumps(jsonable(result)))
    write_atomic(out / "pays.json.xz", packed_json(result))
    write_atomic(out / FIGURE, figure(result))
    write_atomic(out / "pays.md", page(result))
    return result
