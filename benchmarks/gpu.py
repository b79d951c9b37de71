"""`python -m benchmarks.gpu`: batches on a GPU against the CPU, as one table.

It measures environment steps a second against the size of the batch, the share of the device's peak that they are, PPO
end to end (examples/ppo_native_batch.py), and the diagnosis of one recording. Where no device is, the table says "not
measured" in its columns; what a step costs in arithmetic and memory traffic is counted without one (`benchmarks.work`).
``--page docs/gpu.md`` puts the table in its place there.
"""

import argparse
import importlib.util
import json
import time
from pathlib import Path

import numpy as np

from benchmarks.work import work_of
from cable_envs.core.errors import ConfigurationError
from cable_envs.core.files import write_atomic

PLANTS = (
    "CableHole-Position-Sine-v1", "PulleyCircuit-Torque-Sine-v1", "TendonSheath-Position-Sine-v1",
    "AntagonistJoint-Torque-Sine-v1", "Wrist-Position-Sine-v1",
)  # fmt: skip
SIZES = (1024, 16384, 262144)
PRECISIONS = ("float64", "float32")
NOT_MEASURED = "not measured"
PEAKS = {  # double and single precision without tensor cores, operations a second, and bytes a second: data sheets
    "H100 SXM": (34e12, 67e12, 3.35e12),
    "A100 SXM 80 GB": (9.7e12, 19.5e12, 2.04e12),
    "L40S": (1.43e12, 91.6e12, 0.864e12),
    "RTX 4090": (1.29e12, 82.6e12, 1.01e12),
}
BEGIN, END = "<!-- begin: python -m benchmarks.gpu -->", "<!-- end -->"
ROOT = Path(__file__).parents[1]


def device_name():
    """Name of the GPU, or None where there is none."""
    from cable_envs.core.compiling import device

    try:
        cuda = device.module()
    except ConfigurationError:
        return None
    if device.simulated():
        return None
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else name


def _clock(device):
    """Seconds of the core that does the work, whoever else is on it; on a device those of the wall."""
    return time.process_time if device == "cpu" else time.perf_counter


def steps_a_second(env_id, n, seconds, **options):
    """Environment steps a second of a batch, without what Python makes of their infos."""
    import gymnasium as gym

    import cable_envs  # noqa: F401 (registers the environments)

    envs = gym.make_vec(f"cable_envs/{env_id}", num_envs=n, step_infos=False, **options)
    envs.reset(seed=0)
    actions = np.zeros(envs.action_space.shape, dtype=np.float32)
    if "device" in options:
        from numba import cuda

        actions = cuda.to_device(actions)
    envs.step(actions)  # compiles
    clock = _clock(options.get("device", "cpu"))
    done, began = 0, clock()
    while clock() - began < seconds:
        envs.step(actions)  # waits for the device
        done += n
    rate = done / (clock() - began)
    envs.close()
    return rate


def ppo_frames_a_second(device, envs, steps):
    """Steps a second of the example, learning included."""
    path = ROOT / "examples" / "ppo_native_batch.py"
    spec = importlib.util.spec_from_file_location("ppo_native_batch", path)
    ppo = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(ppo)
    ppo.run(envs * ppo.STEPS, device=device, envs=envs, seconds=0.1, tell=lambda text: None)  # compiles
    clock = _clock(device)
    began = clock()
    ppo.run(steps, device=device, envs=envs, seconds=0.1, tell=lambda text: None)
    return steps / (clock() - began)


def diagnosis_seconds(device):
    """Time of the diagnosis of the sample recording."""
    from cable_envs.diagnosis.engine import diagnose
    from cable_envs.sim.replay import replays_on

    clock = _clock(device)
    with replays_on(device):
        began = clock()
        diagnose(ROOT / "examples" / "sample_rig")
        return clock() - began


def measured(gpu, seconds):
    """Every number of the tables by its key; those of a device only where there is one."""
    found = {"device": gpu, "work": {name: vars(work_of(name)) for name in PLANTS}, "rates": {}}
    for name in PLANTS:
        found["rates"][name] = {"cpu": {str(n): steps_a_second(name, n, seconds, threads=1) for n in SIZES[:2]}}
        for precision in PRECISIONS if gpu else ():
            made = {"device": "cuda", "precision": precision}
            found["rates"][name][precision] = {str(n): steps_a_second(name, n, seconds, **made) for n in SIZES}
    found["ppo"] = {"cpu": ppo_frames_a_second("cpu", 64, 200_000)}
    found["diagnosis"] = {"cpu": diagnosis_seconds("cpu")}
    if gpu:
        found["ppo"]["cuda"] = ppo_frames_a_second("cuda", 8192, 20_000_000)
        found["diagnosis"]["cuda"] = diagnosis_seconds("cuda")
    return found


def _million(rate):
    return NOT_MEASURED if rate is None else f"{rate / 1e6:.3g}"


def peak_of(gpu):
    """(double, single, bytes) a second of a device by a part of its name, or None where it is not listed."""
    for name, peak in PEAKS.items():
        if gpu and all(word in gpu for word in name.split()[:1]):
            return peak
    return None


def _share(work, rate, peak, precision):
    if rate is None or peak is None:
        return NOT_MEASURED
    arithmetic, traffic = (
        rate * work["operations"] / peak[PRECISIONS.index(precision)],
        rate * work["traffic"] / peak[2],
    )
    return f"{100 * arithmetic:.2g} %, {100 * traffic:.2g} %"


def table(found):
    """The measured numbers as Markdown."""
    peak, rates = peak_of(found["device"]), found["rates"]
    head = ["environment", *(f"CPU, {n}" for n in SIZES[:2])]
    head += [f"{p}, {n}" for p in PRECISIONS for n in SIZES] + ["share of peak arithmetic, bandwidth (float64)"]
    lines = [
        f"Device: {found['device'] or NOT_MEASURED + ' (there was none)'}. Millions of environment steps a second; "
        "CPU: one core, its own time.", "", "| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1),
    ]  # fmt: skip
    for name in PLANTS:
        row = [f"`{name}`", *(_million(rates[name]["cpu"][str(n)]) for n in SIZES[:2])]
        row += [_million(rates[name].get(p, {}).get(str(n))) for p in PRECISIONS for n in SIZES]
        fastest = rates[name].get("float64", {}).get(str(SIZES[-1]))
        lines.append("| " + " | ".join([*row, _share(found["work"][name], fastest, peak, "float64")]) + " |")
    ppo, seconds = found["ppo"], found["diagnosis"]
    gpu = f"{ppo['cuda'] / 1e3:.3g}" if "cuda" in ppo else NOT_MEASURED
    late = f"{seconds['cuda']:.3g}" if "cuda" in seconds else NOT_MEASURED
    lines += [
        "", "| end to end | CPU, one core | GPU |", "|---|--:|--:|",
        f"| PPO, thousands of steps a second (64 environments; 8192 on a GPU) | {ppo['cpu'] / 1e3:.3g} | {gpu} |",
        f"| diagnosis of examples/sample_rig, s | {seconds['cpu']:.3g} | {late} |",
    ]  # fmt: skip
    return "\n".join(lines)


def bounds(found):
    """What the counted work allows on devices of the data sheets, as Markdown: bounds, not measurements."""
    head = ["environment", "operations", "bytes", "integration steps", *PEAKS]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    for name, work in found["work"].items():
        most = []
        for double, single, traffic in PEAKS.values():
            pair = (min(p / work["operations"], traffic / work["traffic"]) / 1e6 for p in (double, single))
            most.append("{:,.0f}; {:,.0f}".format(*pair))
        counted = f"{work['operations']:,.0f} | {work['traffic']:,} | {work['substeps']}"
        lines.append(f"| `{name}` | {counted} | " + " | ".join(most) + " |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu", description=__doc__)
    parser.add_argument("--seconds", type=float, default=1.0, help="time for each rate")
    parser.add_argument("--out", type=Path, default=Path("results/gpu.json"))
    parser.add_argument("--page", type=Path, help="a page whose marked part is replaced by the tables")
    arguments = parser.parse_args()
    found = measured(device_name(), arguments.seconds)
    text = f"{table(found)}\n\n{bounds(found)}"
    print(text)
    write_atomic(arguments.out, json.dumps(found, indent=1))
    if arguments.page:
        page = arguments.page.read_text(encoding="utf-8")
        before, rest = page.split(BEGIN)
        write_atomic(arguments.page, f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}")


if __name__ == "__main__":
    main()
