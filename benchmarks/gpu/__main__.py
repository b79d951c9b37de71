"""`python -m benchmarks.gpu`: batches on a GPU against the CPU, as tables.

It measures environment steps a second against the size of the batch for each plant, the shares of the device's peaks
that they are, PPO to the error of the CPU's agent (examples/ppo_native_batch.py), the diagnosis of one recording, and
several GPUs at once. Pieces are compiled side by side in processes of their own, and measured one after the other. Each
is saved as soon as it is there: the same command goes on where it was stopped. Where no device is, the tables say "not
measured" in its places. ``--page docs/gpu.md`` puts the tables in their place there.
"""

import argparse
import json
import sys
from pathlib import Path

from benchmarks.gpu import measure, tables
from benchmarks.gpu.pieces import measured, pieces
from cable_envs.core.compiling import device
from cable_envs.core.files import write_atomic

BEGIN, END = "<!-- begin: python -m benchmarks.gpu -->", "<!-- end: gpu -->"


def _parsed(given):
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=__doc__)
    add = parser.add_argument
    add("--cases", nargs="+", choices=measure.CASES, default=list(measure.CASES), help="plants; all by default")
    add("--sizes", nargs="+", type=int, default=list(measure.SIZES), help="environments of a batch on the device")
    add("--seconds", type=float, default=1.0, help="time for each rate")
    add("--jobs", type=int, default=8, help="pieces that are compiled at a time")
    add("--limit", type=float, default=1e9, help="seconds after which no further piece is begun")
    add("--shards", type=int, help="GPUs that are measured together; by default all there are")
    add("--ppo-steps", type=int, default=measure.PPO_STEPS, help="of the CPU's agent")
    add("--ppo-envs", type=int, default=8192, help="environments of the agent on the device")
    add("--ppo-updates", nargs="+", type=int, default=measure.PPO_UPDATES, help="after which it is looked at")
    add("--no-diagnosis", dest="diagnosis", action="store_false", help="leave the diagnosis out")
    add("--core-price", type=float, default=0.05, help="dollars an hour for a core")
    add("--gpu-price", type=float, default=3.0, help="dollars an hour for a GPU")
    add("--least", type=float, default=1e-4, help="seconds that a step of any batch takes on a GPU")
    add("--again", action="store_true", help="measure all anew")
    add("--out", type=Path, default=Path("results/gpu.json"))
    add("--page", type=Path, help="a page whose marked part is replaced by the tables")
    return parser.parse_args(given)


def main(given=None):
    arguments = _parsed(given)
    if arguments.page and device.simulated():
        sys.exit("--page: what numba's simulator of CUDA takes is no speed of a device")
    gpu = measure.device_name()
    before = {}
    if arguments.out.is_file() and not arguments.again:
        before = json.loads(arguments.out.read_text(encoding="utf-8"))
    on_gpu = ("cuda", "float64", "float32", "shards")
    found = {k: v for k, v in before.items() if before.get("device") == gpu or k.rsplit("/", 1)[-1] not in on_gpu}
    found["device"] = gpu
    failed = measured(arguments, found, lambda: write_atomic(arguments.out, json.dumps(found, indent=1)))
    write_atomic(arguments.out, json.dumps(found, indent=1))
    if failed:
        sys.exit(f"without a result: {', '.join(failed)}; the same command tries them again")
    late = [name for name in pieces(arguments, measure.devices()) if name not in found]
    if late:
        sys.exit(f"no time was left for: {', '.join(late)}; the same command goes on with them")
    if set(arguments.cases) != set(measure.CASES):
        return
    text = tables.page(found, arguments)
    print(text)
    if arguments.page:
        tables.put(arguments.page, BEGIN, END, text)


if __name__ == "__main__":
    main()
