"""`python -m benchmarks.corruptions`: what the tool says of good recordings in which one fault has been made.

Every kind of `cable_envs.proof.logs.corruptions` is made in a recording of each set: drives, cables through a hole and
circuits of generator A, and the published sets where they are. A corrupted recording is "refused" on import or by the
checks before the fit, "noted" where they say something that they do not say of the good recording, or it "passes".
With ``--refit`` the nominal parameters are refitted, and "after" is what the checks beside the refitted simulator find:
a diagnosis answers it with "data_fault". With ``--answers`` those that pass are diagnosed, and the table says which end
with an effect's name. The good recordings are checked too: a refusal of one, or a fault found after its refit, is a
false alarm.
"""

import argparse
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.diagnosis.asked import ask, request_of
from cable_envs.diagnosis.data.recording import Recording, load_recording
from cable_envs.diagnosis.engine import diagnose
from cable_envs.diagnosis.fit.likelihood import refit_nominals
from cable_envs.diagnosis.intake.after import after_fit
from cable_envs.diagnosis.intake.claims import off_claims
from cable_envs.diagnosis.intake.gate import gate
from cable_envs.diagnosis.real.sets import FOLDERS, imported
from cable_envs.diagnosis.systems import looked_at
from cable_envs.diagnosis.systems.question import Question
from cable_envs.proof.cases import Case
from cable_envs.proof.logs.cases import make
from cable_envs.proof.logs.corruptions import CORRUPTIONS, Roles, corrupted

EXAM = 1
"""Seed of the exam; checks are developed on others."""
SIMULATED = ("linear_drive", "cable_hole", "pulley_circuit")
PUBLISHED = ("da-vinci-jaw", "band-brake", "emps")
"""The coupled drives are left out: they have one reading of unknown scale and sign beside the voltage."""
RECORDS = 4
"""Of a published set."""
_POSITIONS = ("position", "drive_position", "load_position", "drive_angle", "output_angle")
_EFFORTS = ("force", "drive_tension", "load_tension", "drive_torque", "output_torque")
_COMMANDS = ("position_reference", "drive_velocity_command", "drive_angle_command")
_OTHERS = ("load_tension", "output_torque", "velocity", "band_tension_1", "drive_velocity")
REFUSED, AFTER, NOTED, PASSES, NAMED = "refused", "after", "noted", "passes", "named"


def roles_of(recording: Recording) -> Roles:
    """Channels of a recording by what they are. A voltage is the effort of a drive that has no other."""

    def there(names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name for name in names if name in recording.channels)

    efforts = there(_EFFORTS) or there(("voltage",))
    others = tuple(name for name in there(_OTHERS) if name != efforts[0])
    commands = _COMMANDS[:1] if recording.system == "linear_drive" else _COMMANDS[1:]
    return Roles(there(_POSITIONS), efforts, there(commands), others)


def with_tables(recording: Recording, tables: list[dict[str, np.ndarray]]) -> Recording:
    """The recording with other tables, checked as an import checks them."""
    records = recording.records
    described = {name: c.as_entry() for name, c in recording.channels.items()}
    return Recording.from_arrays(
        recording.system, {r.name: table for r, table in zip(records, tables, strict=True)},
        noise=recording.noise,
        channels={n: {k: v for k, v in e.items() if k in ("offset_free", "hold")} for n, e in described.items()},
        known={n: q.as_entry() for n, q in recording.known.items()},
        nominal={n: q.as_entry() for n, q in recording.nominal.items()}, rig=recording.rig,
        heldout=[r.name for r in records if r.use == "heldout"],
        about={r.name: {"conditions": dict(r.conditions)} for r in records if r.conditions},
        name=recording.path.name,
    )  # fmt: skip


def said_of(recording: Recording, refit: bool = False) -> tuple[str, ...]:
    """("refused", the faults), ("after", those that a refit shows), ("noted", the notes), or ("passes",)."""
    quality = gate(recording, looked_at(recording))
    fatal = [str(fault) for fault in quality.faults if fault.fatal]
    if not fatal:
        fatal = _off_claims(recording)
    if fatal:
        return (REFUSED, *fatal)
    seen = _after(recording) if refit else []
    if seen:
        return (AFTER, *seen)
    return (NOTED, *quality.notes) if quality.notes else (PASSES,)


def _question(recording: Recording) -> Question | None:
    """None where the recording states too little to be asked."""
    try:
        return ask(recording, request_of(recording))
    except ConfigurationError:
        return None


def _off_claims(recording: Recording) -> list[str]:
    """What the simulator with the stated numbers says."""
    question = _question(recording)
    return [] if question is None else [str(fault) for fault in off_claims(recording, question)]


def _after(recording: Recording) -> list[str]:
    """What the simulator with refitted numbers says."""
    question = _question(recording)
    if question is None:
        return []
    fit = refit_nominals(question.fit, question.nominals).fit
    return [one.text for one in after_fit(question, fit) if one.fatal]


def simulated(system: str, seed: int, noise: str = "white, unstated") -> Recording:
    """A recording of generator A with nothing wrong."""
    with tempfile.TemporaryDirectory() as folder:
        make(Case("corruptions", seed, system, "nothing", noise=noise), Path(folder))
        return load_recording(folder)


def published(form: str, shared: Path) -> Recording:
    """The first `RECORDS` records of a published set."""
    with tempfile.TemporaryDirectory() as folder:
        whole = imported(form, shared, Path(folder))
    return replace(whole, records=whole.records[:RECORDS])


def sets(shared: Path | None, seed: int) -> dict[str, Callable[[], Recording]]:
    """Name -> how the set is made or read; published ones only where they are."""
    found: dict[str, Callable[[], Recording]] = {s: partial(simulated, s, seed) for s in SIMULATED}
    if shared is not None:
        there = [form for form in PUBLISHED if (shared / FOLDERS[form]).is_dir()]
        found |= {form: partial(published, form, shared) for form in there}
    return found


def examined(
    recording: Recording, seed: int, answers: bool, refit: bool = False
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """(kind, what is said of it) for every corruption that the recording allows."""
    good, roles = said_of(recording), roles_of(recording)
    tables = [r.data for r in recording.records]
    for number, kind in enumerate(CORRUPTIONS):
        made = corrupted(kind, tables, roles, np.random.default_rng([seed, number]))
        if made is None:
            continue
        try:
            faulty = with_tables(recording, made)
            said = said_of(faulty, refit)
            if said[0] == NOTED:  # what is said of the good recording too is no note of the fault
                known = {_words(text) for text in good[1:]}
                new = [text for text in said[1:] if _words(text) not in known]
                said = (NOTED, *new) if new else (PASSES,)
            if answers and said[0] not in (REFUSED, AFTER):
                said = _answered(faulty, said)
        except ConfigurationError as error:
            said = (REFUSED, str(error))
        yield kind, said


def _words(text: str) -> str:
    """A note without its numbers: a note of the good recording is no new one where its numbers are others."""
    return re.sub(r"[-+.\d]+(e[-+]\d+)?", "#", text)


def _answered(recording: Recording, said: tuple[str, ...]) -> tuple[str, ...]:
    found = diagnose(recording)
    if found.verdict != "named":
        return said
    return (NAMED, ", ".join(f"{e.name} {e.confidence:.2f}" for e in found.effects), *said)


def table_of(results: Mapping[str, Mapping[str, tuple[str, ...]]]) -> str:
    """Kind x set in words, and the sums."""
    width = max(len(kind) for kind in CORRUPTIONS) + 2
    lines = [f"{'':{width}}" + "".join(f"{name:>16}" for name in results)]
    for kind in CORRUPTIONS:
        cells = [results[name][kind][0] if kind in results[name] else "-" for name in results]
        lines.append(f"{kind:{width}}" + "".join(f"{cell:>16}" for cell in cells))
    every = [said[0] for found in results.values() for said in found.values()]
    counts = ", ".join(f"{every.count(word)} {word}" for word in (REFUSED, AFTER, NOTED, PASSES, NAMED))
    return "\n".join([*lines, "", f"{len(every)} corrupted recordings: {counts}"])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.corruptions", description=__doc__)
    parser.add_argument(
        "--shared", type=Path, default=Path("../shared/recordings"), help="folder of the published sets"
    )
    parser.add_argument("--seed", type=int, default=EXAM, help="of the rigs and of the places of the faults")
    parser.add_argument("--only", nargs="*", default=[], help="sets to take; all by default")
    parser.add_argument("--refit", action="store_true", help="refit what is not refused, and check again (minutes)")
    parser.add_argument("--answers", action="store_true", help="diagnose what is not refused (minutes)")
    parser.add_argument("--out", type=Path, help="JSON file for what is said of every case")
    arguments = parser.parse_args()
    shared = arguments.shared if arguments.shared.is_dir() else None
    every = sets(shared, arguments.seed)
    unknown = set(arguments.only) - set(every)
    if unknown:
        parser.error(f"unknown or missing set {', '.join(sorted(unknown))}; valid: {', '.join(every)}")
    results, alarms = {}, []
    for name in arguments.only or every:
        recording = every[name]()
        good = said_of(recording, arguments.refit)
        alarms += [f"{name}: {text}" for text in good[1:]] if good[0] in (REFUSED, AFTER) else []
        results[name] = dict(examined(recording, arguments.seed, arguments.answers, arguments.refit))
    print(table_of(results))
    print(f"good recordings that are refused: {len(alarms)}", *alarms, sep="\n")
    if arguments.out is not None:
        write_atomic(arguments.out, json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
