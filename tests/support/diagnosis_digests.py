"""Digests of seeded diagnoses: what a change that means to change no number must leave as it is.

Recordings are made by the proof's generators, and every answer is reduced to one digest per field of its JSON: names
and numbers (to twelve digits), and the numbers within its texts; no words, no seconds, no version. So a text may be
said better without a new digest, and a number may not change.

Refits differ in their last digits between kinds of processors, so digests are compared between two checkouts on one
machine: ``python -m tests.support.diagnosis_digests --write FILE`` in one, ``--against FILE`` in the other. What must
be the same everywhere, the verdicts and the names, is committed.
"""

import argparse
import hashlib
import json
import re
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.diagnosis import diagnose
from cable_envs.proof.cases import Case, make

FILE = Path(__file__).parent / "golden" / "diagnoses.json"
DIGITS = 12
WORDS = ("notes", "equation", "separating_experiment", "state", "minimum_detectable", "where", "reason")
"""Fields of words, of which only the numbers count."""
LEFT_OUT = ("about", "version", "seconds")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


@dataclass(frozen=True)
class Seeded:
    """A case of the proof's generators and what is asked of it; ``rows``: of each file that are kept (0: all)."""

    system: str
    kind: str
    effects: tuple[str, ...] = ()
    band: str = ""
    noise: str = "white"
    seed: int = 1
    rows: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)
    again: bool = False
    """the corrected rig is diagnosed instead: what the effects that it has leave"""


CASES: Mapping[str, Seeded] = {
    "drive, nothing, white": Seeded("linear_drive", "nothing", seed=101),
    "drive, nothing, flicker": Seeded("linear_drive", "nothing", noise="flicker", seed=102),
    "drive, friction": Seeded("linear_drive", "single", ("stribeck_friction",), "3-10", seed=103),
    "drive, gap": Seeded("linear_drive", "single", ("backlash",), ">10", seed=104),
    "drive, sensor, coloured": Seeded("linear_drive", "single", ("sensor_bias",), "3-10", "ar1", seed=105),
    "drive, ripple": Seeded("linear_drive", "single", ("position_ripple",), "3-10", seed=106),
    "drive, two": Seeded("linear_drive", "pair", ("sensor_scale", "coulomb_friction"), ">10", seed=107),
    "drive, strange": Seeded("linear_drive", "strange", ("floor_vibration",), ">10", seed=108),
    "drive, limit cycle": Seeded(
        "linear_drive", "single", ("backlash",), ">10", seed=492877576,
        options={"effects": ("backlash", "actuator_lag", "stribeck_friction")},
    ),
    "drive, lag": Seeded(
        "linear_drive", "single", ("actuator_lag",), ">10", seed=109,
        options={"effects": ("actuator_lag", "sensor_delay", "backlash", "coulomb_friction")},
    ),
    "drive, corrected rig": Seeded(
        "linear_drive", "single", ("stribeck_friction",), "3-10", seed=103, again=True
    ),
    "hole, nothing, white": Seeded("cable_hole", "nothing", seed=111),
    "hole, drift, coloured": Seeded("cable_hole", "single", ("friction_drift",), ">10", "ar1", seed=112),
    "hole, creep": Seeded("cable_hole", "single", ("viscoelastic_creep",), "3-10", seed=113),
    "circuit, load, closed form": Seeded(
        "pulley_circuit", "single", ("position_dependent_load",), ">10", seed=121, options={"variant": "analytic"}
    ),
    "circuit, delay, chain": Seeded("pulley_circuit", "single", ("sensor_delay",), ">10", seed=122),
}  # fmt: skip


def recording(seeded: Seeded, folder: Path) -> Path:
    """The recording's folder."""
    case = Case(
        "case-0001", seeded.seed, seeded.system, seeded.kind, seeded.effects, seeded.band, seeded.noise
    )  # fmt: skip
    make(case, folder)
    for file in sorted(folder.glob("run_?.csv")) if seeded.rows else ():
        lines = file.read_text().splitlines(keepends=True)
        if file.name != "run_4.csv":  # the record at rest is used whole
            file.write_text("".join(lines[: seeded.rows + 1]))
    return folder


def answered(seeded: Seeded) -> Any:
    """The diagnosis of a case."""
    with tempfile.TemporaryDirectory() as place:
        folder = recording(seeded, Path(place) / "recording")
        found = diagnose(folder, **seeded.options)
        if not seeded.again:
            return found
        rig = Path(place) / "rig"
        found.write(rig)
        return diagnose(folder, rig=rig / found.augmented_rig, **seeded.options)


def content(diagnosis: Any) -> dict[str, Any]:
    """Field -> its names and numbers, as JSON types."""
    data = {key: value for key, value in diagnosis.as_json().items() if key not in LEFT_OUT}
    found = {key: _reduced(value, key) for key, value in data.items()}
    found["rig"] = _reduced(diagnosis.rig, "rig")
    found["traces"] = [
        {
            "record": t.record, "channel": t.channel, "use": t.use, "noise": _reduced(t.noise, ""),
            **{name: _reduced(np.asarray(getattr(t, name), dtype=float).tolist(), "")
               for name in ("time", "measured", "good", "refit", "augmented")},
            "along": {name: _reduced(np.asarray(values).tolist(), "") for name, (_, values) in t.along.items()},
            "shaded": _reduced([list(s) for s in t.shaded], ""),
        }
        for t in diagnosis.traces
    ]  # fmt: skip
    return found


def _reduced(value: Any, key: str) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _reduced(v, key if key in WORDS else str(k)) for k, v in value.items() if k not in LEFT_OUT}
    if isinstance(value, (list, tuple)):
        return [_reduced(v, key) for v in value]
    if isinstance(value, str) and key in WORDS:
        return _NUMBER.findall(value)
    if isinstance(value, (float, np.floating)) and not isinstance(value, bool):
        return float(f"{value:.{DIGITS}g}")
    return value


def digested(found: Mapping[str, Any]) -> dict[str, str]:
    """Field -> the first sixteen digits of its SHA-256; the verdict and the effects' names in plain."""
    made = {"verdict": found["verdict"], "named": ", ".join(e["name"] for e in found["effects"])}
    for key in found.keys() - {"verdict"}:
        text = json.dumps(found[key], sort_keys=True)
        made[key] = hashlib.sha256(text.encode()).hexdigest()[:16]
    return made


def main() -> None:
    """Make the digests of all cases, or of those that are named; say what is not as before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="cases; all of them where none is named")
    parser.add_argument("--write", type=Path, help="file for the digests")
    parser.add_argument("--against", type=Path, default=FILE, help="digests to compare with, made on this machine")
    parser.add_argument("--full", type=Path, help="file for the names and numbers behind them")
    args = parser.parse_args()
    digests, contents = {}, {}
    golden = json.loads(args.against.read_text(encoding="utf-8"))
    for name in args.names or CASES:
        began = time.process_time()
        contents[name] = content(answered(CASES[name]))
        digests[name] = made = digested(contents[name])
        known = golden.get(name, {})
        other = ", ".join(key for key in known if made.get(key) != known[key]) or "none"
        spent = time.process_time() - began
        print(f"{name}: {made['verdict']} {made['named']}; {spent:.0f} s; not as before: {other}", flush=True)
        if args.write:
            args.write.write_text(json.dumps(digests, indent=1) + "\n", encoding="utf-8")
    if args.full:
        args.full.write_text(json.dumps(contents, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
