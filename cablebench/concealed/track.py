"""Running the concealed track: rigs are sealed and recorded, entrants prepare, and are scored. All of it is kept.

A folder of the track has, for each mechanism, ``manifest.json`` (salted hashes of the keys, written before anybody
prepares), ``keys/rig-NN.json``, and ``rig-NN/`` with the recording, what the rows made for this rig, and
``scores/ROW.json``. A run that was stopped goes on.
"""

import json
import math
import secrets
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import json_text, jsonable, write_atomic
from cable_envs.proof.sealing import opened, seal
from cable_envs.sim.registered import setup_of
from cablebench.concealed.entrants import Row
from cablebench.concealed.given import episode_metrics, folder_of, given
from cablebench.concealed.hidden import HiddenRig, drawn, from_key
from cablebench.concealed.mechanism import PROTOCOL, Mechanism
from cablebench.concealed.records import record_hidden
from cablebench.concealed.scores import failed, score_of
from cablebench.protocol.failures import scored_error
from cablebench.protocol.files import load_protocol

MANIFEST = "manifest.json"
SCHEMA = "cable-concealed-manifest/1"
Tell = Callable[[str], None]


def sealed(mechanism: Mechanism, root: Path, rigs: int, seed: int | None) -> list[HiddenRig]:
    """The hidden rigs of a folder; they are drawn and sealed where there are none yet.

    Parameters
    ----------
    mechanism : Mechanism
    root : Path
        The mechanism's folder.
    rigs : int
        How many are wanted.
    seed : int, optional
        Of the draw; None draws one and does not keep it.

    Returns
    -------
    list of HiddenRig
        The first ``rigs`` of them.

    Raises
    ------
    ConfigurationError
        Where the folder holds fewer, or a key that is not the one that was sealed.
    """
    file = root / MANIFEST
    if not file.is_file():
        chosen = secrets.randbits(62) if seed is None else seed
        hashes: dict[str, str] = {}
        for number in range(rigs):
            digest, content = seal(jsonable(drawn(mechanism, chosen, number).key()))
            name = f"rig-{number:02d}"
            write_atomic(root / "keys" / f"{name}.json", content)
            hashes[name] = digest
        write_atomic(file, json_text({"schema": SCHEMA, "mechanism": mechanism.name, "sealed": hashes}))
    hashes = json.loads(file.read_text(encoding="utf-8"))["sealed"]
    if len(hashes) < rigs:
        raise ConfigurationError(f"{root} has {len(hashes)} sealed rigs, not {rigs}: choose another folder for more")
    return [from_key(opened(root / "keys" / f"{name}.json", hashes[name])) for name in sorted(hashes)[:rigs]]


def scored(hidden: HiddenRig, mechanism: Mechanism, row: Row, root: Path, episodes: int, seed: int, tell: Tell) -> Any:
    """The scores of a row on a hidden rig; kept, and taken where they are there already.

    Parameters
    ----------
    hidden : HiddenRig
    mechanism : Mechanism
    row : Row
    root : Path
        The mechanism's folder.
    episodes : int
        Of the test.
    seed : int
        Of the row's own draws.
    tell : callable
        Hears what is going on.

    Returns
    -------
    dict
        ``scores``, ``errors`` (SI), ``failed`` [episodes], and ``seconds`` of preparing.
    """
    about = given(hidden, mechanism, root, row.episodes, seed, tell)
    file = about.folder / "scores" / f"{row.name}.json"
    if file.is_file():
        kept = json.loads(file.read_text(encoding="utf-8"))
        if len(kept["scores"]) >= episodes:  # all rows are compared on the same ones
            return {**kept, **{name: kept[name][:episodes] for name in ("scores", "errors", "failed")}}
    record_hidden(hidden, mechanism, about.recording)
    begun = time.monotonic()
    actor = row.prepare(about)
    seconds = time.monotonic() - begun
    seeds = load_protocol(PROTOCOL).seeds(episodes)
    found = episode_metrics(mechanism.env, hidden.options(mechanism), actor, seeds)
    result = {
        "row": row.name, "scores": [score_of(mechanism.env, m) for m in found],
        "errors": [scored_error(m) for m in found], "failed": [failed(mechanism.env, m) for m in found],
        "seconds": round(seconds, 1),
    }  # fmt: skip
    write_atomic(file, json_text(jsonable(result)))
    return result


def answer(folder: Path, mechanism: Mechanism) -> dict[str, Any] | None:
    """What the diagnosis of a rig said; None where no row has asked for one.

    Some effects of the library are a parameter of the believed simulator that is stated as another value: a spring at
    the load is `load_stiffness`, stated as 0. The refit then finds it, before any effect is asked for. Such an effect
    counts as named where the parameter's 95 % interval leaves out the stated value.

    Returns
    -------
    dict
        ``verdict``, and the ``named`` effects.
    """
    file = folder / "diagnosis" / "diagnosis.json"
    if not file.is_file():
        return None
    found = json.loads(file.read_text(encoding="utf-8"))
    aliases = setup_of(mechanism.env, {}).plant.effects.aliases
    refitted = {aliases[name]: name.partition(".")[0] for name in mechanism.library if name in aliases}
    moved = [refitted[name] for name, value in found["absorbed"].items() if name in refitted and _moved(value)]
    named = dict.fromkeys([*(effect["name"] for effect in found["effects"]), *moved])  # once, however it was found
    return {"verdict": found["verdict"], "named": list(named)}


def _moved(value: Mapping[str, Any]) -> bool:
    """Whether the 95 % interval of a refitted parameter leaves out what was stated."""
    low, high = value["ci95"] or (-math.inf, math.inf)
    return not low <= value["before"] <= high


def run(
    mechanism: Mechanism, rows: Sequence[Row], root: Path, rigs: int, episodes: int, seed: int, draw: int | None,
    tell: Tell,
) -> list[Mapping[str, Any]]:  # fmt: skip
    """Every row on every hidden rig, rig after rig.

    Parameters
    ----------
    mechanism : Mechanism
    rows : sequence of Row
    root : Path
        The mechanism's folder.
    rigs, episodes : int
        How many hidden rigs, and test episodes on each.
    seed : int
        Of what the rows draw.
    draw : int, optional
        Seed of the hidden rigs; None: one is drawn and not kept.
    tell : callable
        Hears what is going on.

    Returns
    -------
    list of mapping
        For each rig ``hidden``, its opened key; ``rows``: what `scored` gives by name; ``answer``: of `answer`.
    """
    found: list[Mapping[str, Any]] = []
    for hidden in sealed(mechanism, root, rigs, draw):
        of_rig = {}
        for row in rows:
            if not row.enters(mechanism):
                continue
            tell(f"{mechanism.name}, rig {hidden.number}: {row.name}")
            of_rig[row.name] = scored(hidden, mechanism, row, root, episodes, seed, tell)
        said = answer(folder_of(hidden, root), mechanism)
        found.append({"hidden": hidden.key(), "rows": of_rig, "answer": said})
    return found
