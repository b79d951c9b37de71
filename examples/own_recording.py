"""A recording of one's own: from the log of a rig to the physics that its simulator leaves out.

The file first plays the rig, so that the example needs no hardware: a slide on a linear axis, pushed by a measured
force, with dry friction and a spring that its model lacks. It writes what a logger would write (`slow.csv` and
`fast.csv`: time in ms, position in mm, force in N, with the noise of the sensors) and a mapping that says what the
columns mean. With logs of a real rig only the mapping has to be written. Then the logs are imported, and diagnosed
against a slide without a spring, whose mass and friction are only believed. It prints the verdict and the parameters.

    python examples/own_recording.py --out sample            # half a minute; sample/answer/report.html is the page

The same by the command line, from the logs that are then in sample/logs:

    cablebench import table sample/logs --mapping sample/axis.yaml --heldout fast.csv --out axis
    cablebench diagnose axis --out axis-answer
"""

import argparse
import subprocess
import sys
from pathlib import Path

import numpy as np

TRUE = {"mass": 11.4, "viscous": 35.0, "coulomb": 9.0, "spring": 250.0}
"""What the rig is: kg, N s/m, N, N/m."""
MAPPING = """schema: cable-mapping/1
system: linear_drive
description: a slide on a linear axis, force measured at the slide
channels:
  time:     {column: t, unit: ms}
  position: {column: x, unit: mm, noise_std: 0.01}
  force:    {column: F, unit: N, noise_std: 0.05}
nominal:                                  # believed, refitted by the diagnosis
  mass:    {value: 12, unit: kg, std: 2}
  viscous: {value: 40, unit: N s/m, std: 15}
  coulomb: {value: 8, unit: N, std: 3}
"""


def log(pace: float, seconds: float, rng: np.random.Generator) -> str:
    """A table of one run: a position controller lets the slide follow two sines; every 5 ms is logged."""
    x = v = 0.0
    step, rows = 1e-4, ["t,x,F"]
    for k in range(round(seconds / step)):
        t = k * step
        wanted = 0.04 * np.sin(pace * t) + 0.01 * np.sin(3.1 * pace * t)
        rate = 0.04 * pace * np.cos(pace * t) + 0.031 * pace * np.cos(3.1 * pace * t)
        force = 8000.0 * (wanted - x) + 500.0 * (rate - v)
        if k % 50 == 0:
            rows.append(f"{1e3 * t:.1f},{1e3 * x + rng.normal(0.0, 0.01):.4f},{force + rng.normal(0.0, 0.05):.4f}")
        pull = force - TRUE["viscous"] * v - TRUE["spring"] * x
        if v == 0.0 and abs(pull) <= TRUE["coulomb"]:
            continue  # it sticks
        faster = v + step * (pull - TRUE["coulomb"] * np.sign(v or pull)) / TRUE["mass"]
        v = 0.0 if faster * v < 0.0 else faster
        x += step * v
    return "\n".join(rows) + "\n"


def write_logs(folder: Path, seconds: float = 12.0, seed: int = 0) -> None:
    """``folder``/logs/slow.csv, ``folder``/logs/fast.csv and ``folder``/axis.yaml."""
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    for name, pace in (("slow", 1.7), ("fast", 2.9)):
        (folder / "logs" / f"{name}.csv").write_text(log(pace, seconds, rng))
    (folder / "axis.yaml").write_text(MAPPING)


def main(arguments: list[str] | None = None) -> None:
    """The command line of this file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("sample"), help="folder for logs, recording and answer")
    parser.add_argument("--seconds", type=float, default=12.0, help="length of each log")
    parser.add_argument("--only-logs", action="store_true", help="stop after the logs and the mapping")
    chosen = parser.parse_args(arguments)
    write_logs(chosen.out, chosen.seconds)
    print(f"wrote {chosen.out / 'logs'} and {chosen.out / 'axis.yaml'}")
    if not chosen.only_logs:
        folder, answer = str(chosen.out / "recording"), str(chosen.out / "answer")
        mapping = ["--mapping", str(chosen.out / "axis.yaml"), "--heldout", "fast.csv"]
        for command in (["import", "table", str(chosen.out / "logs"), *mapping, "--out", folder],
                        ["diagnose", folder, "--out", answer]):  # fmt: skip
            print("$ cablebench", *command, flush=True)
            subprocess.run([sys.executable, "-m", "cablebench.cli", *command], check=True)


if __name__ == "__main__":
    main()
