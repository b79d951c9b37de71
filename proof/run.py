"""One proof in a folder: recordings and sealed keys, verdicts of the tool and the baselines, results.

    manifest.json                 hash of every sealed key and recording; written before anything is diagnosed
    recordings/<case>/            all that a tool is given
    keys/<case>.json              salt and key; read by `scored` only
    verdicts/<method>/<case>.json verdict, seconds, or why there is none; "missing": the tool was killed, which says
                                  nothing about it: the case is tried again, and counted by nobody until then

Every step keeps what is finished: the same call goes on from there. Jobs have the signature of `cablebench.jobs`. The
tool that is judged, and what reads a recording for the baselines, are handed in: nothing of either is imported here.
"""

import ctypes
import json
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic
from cable_envs.proof.baselines import BASELINES
from cable_envs.proof.cases import Case, make
from cable_envs.proof.family_b.cases import make as second
from cable_envs.proof.scoring import Result, judge
from cable_envs.proof.sealing import MANIFEST_SCHEMA, opened, seal
from cable_envs.proof.writing import digest

TOOL = "diagnose"
LIMIT = 900.0
"""s that the tool may take for one recording."""

PR_SET_PDEATHSIG = 1
"""As in linux/prctl.h."""

INTERRUPTED = (130, 137, 143)
"""Exit codes that say, like a signal itself, that somebody ended the tool (SIGINT, SIGKILL, SIGTERM)."""


class Killed(Exception):
    """The tool was ended from outside: by a signal, as of a machine without memory, or by the time limit."""


GENERATORS: Mapping[str, Callable[[Case, Path], dict[str, Any]]] = {"a": make, "b": second}
"""What makes the recording and the key of a case."""


def make_one(context: Any, case: Case, out: str, generator: str = "a") -> dict[str, str]:
    """Job: the recording and the sealed key of a case; its line of the manifest. A finished one is kept."""
    folder, key_file = Path(out, "recordings", case.name), Path(out, "keys", f"{case.name}.json")
    if key_file.is_file():
        content = json.loads(key_file.read_text(encoding="utf-8"))
        if content["key"]["case"] == json.loads(json.dumps(asdict(case))):
            return {"sealed": seal(content["key"], content["salt"])[0], "recording": digest(folder)}
        raise ConfigurationError(f"{key_file} belongs to another proof; choose another --out")
    shutil.rmtree(folder, ignore_errors=True)
    key = json.loads(json.dumps(GENERATORS[generator](case, folder)))  # JSON's types: the hash is that of the file
    sealed, text = seal(key)
    write_atomic(key_file, text)  # last: its presence says that the case is finished
    return {"sealed": sealed, "recording": digest(folder)}


def write_manifest(out: Path, lines: Mapping[str, Mapping[str, str]], about: Mapping[str, Any]) -> dict[str, Any]:
    """Write the manifest, or check the one that is there. Raises ConfigurationError where keys or data have changed."""
    file = out / "manifest.json"
    manifest = {"schema": MANIFEST_SCHEMA, **about, "cases": {name: dict(lines[name]) for name in sorted(lines)}}
    if file.is_file():
        try:
            before = json.loads(file.read_text(encoding="utf-8"))
        except ValueError as problem:
            raise ConfigurationError(f"{file} is damaged ({problem}): choose another --out") from None
        if before != json.loads(json.dumps(manifest)):
            changed = [n for n in manifest["cases"] if before.get("cases", {}).get(n) != manifest["cases"][n]]
            same_plan = before.get("plan") == manifest.get("plan")
            what = f"cases {', '.join(changed[:3])}" if changed else "the tool" if same_plan else "its plan"
            raise ConfigurationError(f"{file}: {what} changed since the keys were sealed; choose another --out")
        return before
    write_atomic(file, json.dumps(manifest, indent=1) + "\n")
    return manifest


def diagnose_one(
    context: Any, name: str, out: str, method: str, command: Sequence[str] = (),
    read: Callable[[Path], Any] | None = None,
) -> bool:  # fmt: skip
    """Job: the verdict of a method on one recording. A finished one is kept, a missing one tried again.

    The tool works on a copy of the recording in an empty folder: nothing beside it tells what it is. Baselines run
    here.

    Parameters
    ----------
    context : object
        Of the job; not used.
    name : str
        The case.
    out : str
        The proof's folder.
    method : str
        `TOOL`, or a key of `cable_envs.proof.baselines.BASELINES`.
    command : sequence of str
        The tool, to which FOLDER --json are added.
    read : callable, optional
        (folder) -> recording, as the baselines take it (`cable_envs.proof.baselines`).

    Returns
    -------
    bool
        Whether there is a verdict; what went wrong is in the file.
    """
    file = Path(out, "verdicts", method, f"{name}.json")
    if file.is_file():
        content = json.loads(file.read_text(encoding="utf-8"))
        if not _missing(content):
            return content["verdict"] is not None
    started, verdict, error, killed = time.monotonic(), None, "", ""
    with tempfile.TemporaryDirectory(prefix="recording-") as place:
        folder = Path(place, "recording")
        shutil.copytree(Path(out, "recordings", name), folder)
        try:
            verdict = _tool(command, folder, Path(place)) if method == TOOL else _baseline(method, folder, read)
        except Killed as problem:  # that says nothing about the tool
            killed = str(problem)
        except Exception as problem:  # a tool that fails has given no verdict: that is a result
            error = f"{type(problem).__name__}: {problem}"[:2000]
    content = {"verdict": verdict, "error": error, "seconds": round(time.monotonic() - started, 3)}
    if killed:
        content["missing"] = killed
    write_atomic(file, json.dumps(content, indent=1) + "\n")
    return verdict is not None


def _missing(content: Mapping[str, Any]) -> str:
    """Why a verdict is missing, as its file says; empty where there is one, or where the tool failed by itself."""
    return str(content.get("missing", ""))


def _tool(command: Sequence[str], folder: Path, place: Path) -> dict[str, Any]:
    try:
        done = subprocess.run(
            [*command, str(folder), "--json"], capture_output=True, text=True, timeout=LIMIT, cwd=place,
            preexec_fn=_ends_with_me(),
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise Killed(f"not ended within {LIMIT:g} s") from None
    if done.returncode < 0 or done.returncode in INTERRUPTED:
        number = -done.returncode if done.returncode < 0 else done.returncode - 128
        raise Killed(f"killed by signal {number} ({signal.Signals(number).name})")
    if done.returncode != 0:
        raise RuntimeError(f"exit code {done.returncode}: {done.stderr.strip()[-1500:]}")
    return checked(json.loads(done.stdout))


def _ends_with_me() -> Callable[[], None] | None:
    """For a child of this process: it is to be killed when this one dies, of whatever. Linux alone can do that."""
    if sys.platform != "linux":
        return None
    ask = ctypes.CDLL(None).prctl

    def ends() -> None:
        ask(PR_SET_PDEATHSIG, signal.SIGKILL)

    return ends


def _baseline(method: str, folder: Path, read: Callable[[Path], Any] | None) -> dict[str, Any]:
    if read is None:
        raise ConfigurationError(f"'{method}' runs in this process: it takes a function that reads a recording")
    return checked(BASELINES[method](read(folder)))


VERDICTS = ("named", "equivalence_class", "partly_named", "unknown", "data_fault", "no_detectable_mismatch")


def checked(verdict: Any) -> dict[str, Any]:
    """A verdict of the right schema; ValueError otherwise."""
    if not isinstance(verdict, dict) or verdict.get("schema") != "cable-diagnosis/1":
        raise ValueError("not a verdict of schema cable-diagnosis/1")
    if verdict.get("verdict") not in VERDICTS:
        raise ValueError(f"verdict {verdict.get('verdict')!r} is none of {', '.join(VERDICTS)}")
    return verdict


def scored(out: Path, manifest: Mapping[str, Any], method: str) -> list[Result]:
    """Results of a method: every verdict is there before the first key is opened. Missing cases are not among them.

    Raises ConfigurationError where a case was not tried yet or a key is not the sealed one.
    """
    found = {name: _content(out, method, name) for name in manifest["cases"]}
    verdicts = {name: content["verdict"] for name, content in found.items() if not _missing(content)}
    keys = {n: opened(out / "keys" / f"{n}.json", line["sealed"]) for n, line in manifest["cases"].items()}
    return [judge(keys[name], verdict) for name, verdict in verdicts.items()]


def missing(out: Path, manifest: Mapping[str, Any], method: str) -> dict[str, str]:
    """The cases on which a method was killed, with how: no verdict, and no failure either."""
    found = {name: _missing(_content(out, method, name)) for name in manifest["cases"]}
    return {name: why for name, why in found.items() if why}


def _content(out: Path, method: str, name: str) -> dict[str, Any]:
    file = out / "verdicts" / method / f"{name}.json"
    if not file.is_file():
        raise ConfigurationError(f"{file}: no verdict yet")
    return json.loads(file.read_text(encoding="utf-8"))


def prove(
    diagnose: Callable[[Path], Mapping[str, Any] | None], cases: Sequence[Case], out: Path, about: Mapping[str, Any]
) -> list[Result]:
    """The whole proof in this process of a callable that takes a recording's folder: for tests and notebooks."""
    lines = {case.name: make_one(None, case, str(out)) for case in cases}
    manifest = write_manifest(out, lines, about)
    results = []
    verdicts = {name: diagnose(out / "recordings" / name) for name in manifest["cases"]}
    for name, line in manifest["cases"].items():
        results.append(judge(opened(out / "keys" / f"{name}.json", line["sealed"]), verdicts[name]))
    return results
