"""`python -m benchmarks`: run the cases, print the table, save it as JSON."""

import argparse
import json
import os
import platform
import time
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks.cases import CASES
from benchmarks.pairs import Result
from cable_envs.core.files import write_atomic

SUBSTEPS = 10


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("cases", nargs="*", help=f"which ({', '.join(CASES)}); all by default")
    parser.add_argument("--pairs", type=int, default=9, help="pairs of a comparison; the median counts")
    parser.add_argument("--seconds", type=float, default=0.4, help="time for each half of a pair")
    parser.add_argument("--out", type=Path, default=Path("results/speed.json"))
    arguments = parser.parse_args()
    unknown = set(arguments.cases) - set(CASES)
    if unknown:
        parser.error(f"unknown case {', '.join(sorted(unknown))}; valid: {', '.join(CASES)}")
    if arguments.pairs < 7:
        parser.error("fewer than 7 pairs give no median worth stating")
    load = os.getloadavg() if hasattr(os, "getloadavg") else ()
    print(f"{_machine()}; load average {', '.join(f'{v:.1f}' for v in load) or 'unknown'}")
    print(f"{arguments.pairs} pairs of 2 x {arguments.seconds} s, by turns")
    print("rates: environment steps a second; ours integrate ten substeps in each, the peers one (sb3: as shipped)\n")
    print(f"{'':52}{'median':>8} {'quartiles':>17} {'target':>9}")
    results = []
    for name in arguments.cases or CASES:
        for result in CASES[name](arguments.pairs, arguments.seconds):
            results.append(result)
            _show(result)
    _save(arguments.out, results, load)
    print(f"\nsaved to {arguments.out}")


def _show(result: Result) -> None:
    if result.value != result.value:
        print(f"{result.name:52}{'-':>8} {'':17} {result.target:>9}   {result.note}", flush=True)
        return
    low, high = result.spread
    verdict = {True: "met", False: "MISSED", None: ""}[result.met]
    numbers = f"{result.value:8.3g} {f'[{low:.3g}, {high:.3g}]':>17} {result.target:>9} {verdict:7}"
    rates = "; ".join(f"{name} {_si(rate)}" for name, rate in result.rates.items())
    print(f"{result.name:52}{numbers} {'; '.join(t for t in (rates, result.note) if t)}", flush=True)


def _si(rate: float) -> str:
    for factor, letter in ((1e6, "M"), (1e3, "k")):
        if rate >= factor:
            return f"{rate / factor:.3g} {letter}/s"
    return f"{rate:.3g} /s"


def _machine() -> str:
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.is_file():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":", 1)[1].strip() if lines else model
    return f"{model}, {os.cpu_count()} cores"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _save(path: Path, results: list[Result], load: tuple[float, ...]) -> None:
    """Written beside and moved into place, so that a stopped run leaves the last good file."""
    packages = ("cable-envs", "gymnasium", "numba", "llvmlite", "numpy", "envpool", "stable-baselines3", "torch")
    content = {
        "schema": "cable-speed/1",
        "time": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "machine": _machine(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in packages},
        "load_average_before": list(load),
        "unit": f"environment steps a second; {SUBSTEPS} integration substeps in each step of ours",
        "results": [
            {k: (None if isinstance(v, float) and v != v else v) for k, v in asdict(r).items()} for r in results
        ],
    }
    write_atomic(path, json.dumps(content, indent=2) + "\n")


if __name__ == "__main__":
    main()
