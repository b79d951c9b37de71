"""`make interop`: other projects' tests and libraries on this project's environments, with a table of what passed.

    python -m tests.interop.peers [--out build/interop]

fetches by pip, from PyPI, the libraries of clients.txt and the source distribution of stable-baselines3, puts this
project's environments in the place of theirs (substitutes.py), and runs their test files and tests/interop. It ends
with 1 where anything fails that `KNOWN` does not expect.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tarfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
THEIR_ID = re.compile(r"CartPole-v[01]|Pendulum-v1")

FILES = (
    "test_vec_check_nan.py", "test_vec_envs.py", "test_vec_extract_dict_obs.py", "test_vec_monitor.py",
    "test_vec_normalize.py", "test_vec_stacked_obs.py", "test_envs.py", "test_env_checker.py", "test_monitor.py",
)  # fmt: skip
"""Of stable-baselines3: what it asks of vectorised environments, of environments, and of its monitor around them."""

PASSED_OVER = "Subproc or subproc or is_wrapped"
"""Not run: their own toy environments in processes of their own; nothing of this project is in them."""

KNOWN = {
    "test_vec_monitor_ppo": "asks for no warning; the native batch counts episodes itself, so VecMonitor warns of two",
    "test_get_original": "asks for CartPole's reward, 1 at every step",
    "test_env[": "asks for the warning that check_env has for CartPole and Pendulum; it has none for this environment",
    "test_monitor_error_cases": "resets with an option that does not exist, which is refused by name here",
}
"""Tests of stable-baselines3 that hold properties of their own environments, by the beginning of their names."""

NAMES = {
    "test_gymnasium": "Gymnasium", "stable_baselines3": "stable-baselines3", "sb3_contrib": "sb3-contrib",
    "torchrl": "TorchRL", "skrl": "skrl", "minari": "Minari", "d3rlpy": "d3rlpy", "tianshou": "Tianshou",
    "rl_zoo3": "RL Baselines3 Zoo", "video": "Gymnasium",
}  # fmt: skip
"""What a test of tests/interop has in its name -> the library that it is of."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.interop.peers", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "interop")
    out = parser.parse_args().out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    clients = fetched_clients(out)
    theirs = results(out, "stable-baselines3", adapted(out, version("stable_baselines3")), clients)
    ours = results(out, "clients", ["-p", "no:xdist", str(HERE)], clients)
    write_table(out / "table.md", theirs, ours)
    print((out / "table.md").read_text())
    wrong = [name for name, how in (*theirs.items(), *ours.items()) if how == "failed" and not reason(name)]
    print("\n".join(f"not expected to fail: {name}" for name in wrong))
    return int(bool(wrong) or not theirs or not ours)


def fetched_clients(out: Path) -> Path:
    """The folder with the libraries of clients.txt; made anew where the file has changed."""
    wanted, folder, mark = HERE / "clients.txt", out / "clients", out / "clients.installed"
    if not mark.is_file() or mark.read_text() != wanted.read_text():
        shutil.rmtree(folder, ignore_errors=True)
        pip("install", "--no-deps", "--no-compile", "--target", str(folder), "-r", str(wanted))
        mark.write_text(wanted.read_text())
    return folder


def adapted(out: Path, wanted: str) -> list[str]:
    """pytest's arguments for stable-baselines3's own test files, with this project's environments in them."""
    folder, name = out / "sdist", f"stable_baselines3-{wanted}"
    if not (folder / f"{name}.tar.gz").is_file():
        pip("download", "--no-deps", "--no-binary", ":all:", "-d", str(folder), f"stable_baselines3=={wanted}")
    target = out / "stable-baselines3" / "tests"
    shutil.rmtree(target, ignore_errors=True)
    with tarfile.open(folder / f"{name}.tar.gz") as archive:
        archive.extractall(out / "unpacked", filter="data")
    shutil.copytree(out / "unpacked" / name / "tests", target)
    (target / "__init__.py").unlink(missing_ok=True)
    for file in FILES:
        (target / file).write_text(substituted((target / file).read_text()))
    shutil.copy(HERE / "substitutes.py", target)
    place = ["-c", os.devnull, f"--rootdir={target}", "--timeout", "120", "-k", f"not ({PASSED_OVER})"]
    return ["-p", "no:cacheprovider", *place, *(str(target / file) for file in FILES)]


def substituted(text: str) -> str:
    """A test file with the two substitutions: the id of the environment, and the native batch for DummyVecEnv."""
    text = THEIR_ID.sub("CableShort-v0", text)
    lines = [
        line if line.startswith(("from ", "import ")) or line.strip() == "DummyVecEnv,"
        else re.sub(r"\bDummyVecEnv\b", "Batch", line)
        for line in text.splitlines()
    ]  # fmt: skip
    return "\n".join(["from substitutes import Batch", *lines, ""])


def results(out: Path, name: str, arguments: list[str], clients: Path) -> dict[str, str]:
    """How each test ended: passed, skipped or failed, by "file::test"."""
    report = out / f"{name}.xml"
    report.unlink(missing_ok=True)
    # the clients come last: what constraints.txt pins is found first
    code = f"import sys, pytest; sys.path.append({str(clients)!r}); sys.exit(pytest.main(sys.argv[1:]))"
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "CABLE_CLIENTS": str(clients)}
    command = [sys.executable, "-c", code, "-q", "--tb=line", f"--junitxml={report}", *arguments]
    subprocess.run(command, cwd=ROOT, env=environment, check=False)
    ended = {}
    for case in ElementTree.parse(report).iter("testcase") if report.is_file() else ():
        tags = {child.tag for child in case}
        how = "failed" if tags & {"failure", "error"} else "skipped" if "skipped" in tags else "passed"
        ended[f"{case.get('classname', '').split('.')[-1]}::{case.get('name')}"] = how
    return ended


def reason(name: str) -> str:
    """Why a test of another project is expected to fail; empty: it is not."""
    test = name.split("::")[-1]
    return next((why for known, why in KNOWN.items() if test.startswith(known)), "")


def library(name: str) -> str:
    """Which library a test of tests/interop is of."""
    return next((title for word, title in NAMES.items() if word in name), "Gymnasium")


def write_table(path: Path, theirs: dict[str, str], ours: dict[str, str]) -> None:
    """A row for each suite: passed of run, skipped, and why the rest was not passed."""
    lines = ["| suite | passed | skipped | not passed |", "|---|--:|--:|---|"]

    def row(title: str, ended: dict[str, str]) -> str:
        counts = Counter(ended.values())
        failed = [
            f"`{n.split('::')[-1]}`: {reason(n) or 'not expected'}" for n, how in ended.items() if how == "failed"
        ]
        run = len(ended) - counts["skipped"]
        return f"| {title} | {counts['passed']} of {run} | {counts['skipped']} | {'; '.join(failed)} |"

    lines.append(row(f"stable-baselines3 {version('stable_baselines3')}, its own test files", theirs))
    by_library: dict[str, dict[str, str]] = {}
    for name, how in ours.items():
        by_library.setdefault(library(name), {})[name] = how
    lines.extend(row(f"{title}, tests/interop", ended) for title, ended in sorted(by_library.items()))
    path.write_text("\n".join(lines) + "\n")


def pip(*arguments: str) -> None:
    """Run pip, and stop where it fails."""
    subprocess.run([sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments], check=True)


if __name__ == "__main__":
    sys.exit(main())
