"""`python -m benchmarks.unlike`: write the logs of the rigs, with what their owners know and what is true."""

import argparse
import json
from pathlib import Path

from benchmarks.unlike.rigs import RIGS
from cable_envs.core.files import write_atomic


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.unlike", description=__doc__)
    parser.add_argument("rigs", nargs="*", help=f"which ({', '.join(RIGS)}); all by default")
    parser.add_argument("--seed", type=int, default=0, help="which rigs are drawn")
    parser.add_argument("--out", type=Path, default=Path("results/unlike"))
    arguments = parser.parse_args()
    if unknown := set(arguments.rigs) - set(RIGS):
        parser.error(f"unknown rig {', '.join(sorted(unknown))}; valid: {', '.join(RIGS)}")
    for name in arguments.rigs or RIGS:
        log = RIGS[name](arguments.seed)
        log.write(arguments.out / name)
        key = {"about": log.about, "heldout": log.heldout, "owner": log.owner, "truth": log.truth}
        write_atomic(arguments.out / f"{name}.json", json.dumps(key, indent=1) + "\n")
        print(f"{arguments.out / name}: {', '.join(log.files)}; {log.about}")


if __name__ == "__main__":
    main()
