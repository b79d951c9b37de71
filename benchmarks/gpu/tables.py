"""The measured numbers as Markdown; what no device has measured says so."""

from benchmarks.gpu.measure import CASES, CPU_SIZES, SIZES
from cable_envs.core.files import write_atomic
from cable_envs.core.text import between_marks

NOT_MEASURED = "not measured"
PRECISIONS = ("float64", "float32")
PEAKS = {  # double and single precision without tensor cores, operations a second, and bytes a second: data sheets
    "H200": (34e12, 67e12, 4.8e12),
    "H100 SXM": (34e12, 67e12, 3.35e12),
    "A100 SXM 80 GB": (9.7e12, 19.5e12, 2.04e12),
    "L40S": (1.43e12, 91.6e12, 0.864e12),
    "RTX 4090": (1.29e12, 82.6e12, 1.01e12),
}
_KNOWN_BY = {"H200": "H200", "H100": "H100 SXM", "A100": "A100 SXM 80 GB", "L40S": "L40S", "RTX 4090": "RTX 4090"}
"""Part of the name that a driver gives -> name in `PEAKS`."""


def put(page, begin, end, text):
    """Replace what is between two marks of a page."""
    write_atomic(page, between_marks(page.read_text(encoding="utf-8"), begin, end, text))


def markdown(head, rows):
    """A table of Markdown, numbers to the right."""
    lines = ["| " + " | ".join(head) + " |", "|---|" + "--:|" * (len(head) - 1)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def _million(rate):
    return NOT_MEASURED if rate is None else f"{rate / 1e6:,.3g}" if rate < 1e9 else f"{rate / 1e6:,.0f}"


def peak_of(gpu):
    """(double, single, bytes) a second of a device by its name, or None where it is not listed."""
    return next((PEAKS[name] for part, name in _KNOWN_BY.items() if gpu and part in gpu), None)


def rates(found, gpu):
    """Steps a second against the size of the batch, and the shares of the device's peaks at the fastest."""
    sizes = sorted({*CPU_SIZES, *SIZES})
    head = ["environment", "on", *(f"{n:,}" for n in sizes), "share of peak arithmetic", "share of bandwidth"]
    rows = []
    for case in CASES:
        cpu = found.get(f"rates/{case}/cpu", {})
        rows.append([case, "CPU", *(_million(cpu[str(n)]) if str(n) in cpu else "" for n in sizes), "", ""])
        for precision in PRECISIONS:
            measured = found.get(f"rates/{case}/{precision}")
            if measured is None:
                rows.append([case, f"GPU, {precision}", *(NOT_MEASURED if n in SIZES else "" for n in sizes)])
                rows[-1] += [NOT_MEASURED, NOT_MEASURED]
                continue
            cells = [_million(measured[str(n)]) if str(n) in measured else "" for n in sizes]
            work, peak = found[f"work/{case}"], peak_of(gpu)
            rows.append([case, f"GPU, {precision}", *cells, *_shares(work, max(measured.values()), peak, precision)])
    return markdown(head, rows)


def _shares(work, rate, peak, precision):
    if peak is None:
        return ["peak not listed"] * 2
    arithmetic = rate * work["operations"] / peak[PRECISIONS.index(precision)]
    return [f"{100 * part:.2g} %" for part in (arithmetic, rate * work["traffic"] / peak[2])]


def end_to_end(found):
    """Training, diagnosis, and several devices."""
    cpu, tried = found.get("ppo/cpu"), found.get("ppo/cuda")
    late, shards = found.get("diagnosis/cuda"), found.get("shards")
    trained = NOT_MEASURED
    if tried:
        last = tried[-1]
        trained = f"{last['seconds']:.3g} s, {last['steps']:,} steps, {1e3 * last['error']:.2g} mm"
    rows = [
        ["PPO of examples/ppo_native_batch.py to the error of the CPU's agent",
         f"{cpu['seconds']:.3g} s, {cpu['steps']:,} steps, {1e3 * cpu['error']:.2g} mm" if cpu else NOT_MEASURED,
         trained],
        ["diagnosis of examples/sample_rig", f"{found['diagnosis/cpu']:.3g} s" if "diagnosis/cpu" in found else
         NOT_MEASURED, f"{late:.3g} s" if late else NOT_MEASURED],
        ["hole on several GPUs, float32, millions of steps a second", "",
         f"{len(shards)} GPUs: {_million(sum(shards))}" if shards else NOT_MEASURED],
    ]  # fmt: skip
    return markdown(["end to end", "CPU, one core", "GPU"], rows)


def bound(work, peak, precision):
    """Steps a second that the counted work allows at most."""
    return min(peak[PRECISIONS.index(precision)] / work["operations"], peak[2] / work["traffic"])


def bounds(found):
    """What the counted work allows on devices of the data sheets, in double and in single precision, in millions."""
    rows = []
    for case in CASES:
        work = found[f"work/{case}"]
        most = ["; ".join(f"{bound(work, peak, p) / 1e6:,.0f}" for p in PRECISIONS) for peak in PEAKS.values()]
        rows.append([case, f"{work['operations']:,.0f}", f"{work['traffic']:,}", str(work["substeps"]), *most])
    return markdown(["environment", "operations", "bytes", "integration steps", *PEAKS], rows)


def dollars(found, core, gpu, cores=64):
    """Steps a second, and for a dollar, of a core, of a cluster of cores, and of a GPU at its fastest.

    core, gpu: dollars an hour. A cluster makes at most as many times the steps as it has cores.
    """
    rows = []
    for case in CASES:
        rate = found[f"rates/{case}/cpu"][str(CPU_SIZES[-1])]
        fastest = [max(found.get(f"rates/{case}/{p}", {}).values(), default=None) for p in PRECISIONS]
        each = [NOT_MEASURED if one is None else f"{3.6e-6 * one / gpu:,.0f}" for one in fastest]
        on_gpu = "; ".join(map(_million, fastest)), "; ".join(each)
        rows.append(
            [case, _million(rate), _million(cores * rate), on_gpu[0], f"{3.6e-6 * rate / core:,.0f}", on_gpu[1]]
        )
    head = [
        "environment", "a core, 10^6 steps/s", f"{cores} cores (Ray), at most", "GPU, float64; float32",
        "cores, 10^9 steps for a dollar", "GPU, 10^9 steps for a dollar",
    ]  # fmt: skip
    return markdown(head, rows)


def costs(found, core, gpu, least, peak="H100 SXM"):
    """From where a GPU pays, and what the host allows it.

    core, gpu: dollars an hour. least: seconds that a step of any batch takes on a GPU.
    """
    rows = []
    for case in CASES:
        rate, episode = found[f"rates/{case}/cpu"][str(CPU_SIZES[-1])], found[f"episodes/{case}"]
        even, host = rate * gpu / core, episode["steps"] / episode["each"]
        part = even / bound(found[f"work/{case}"], PEAKS[peak], "float64")
        rows.append([
            case, f"{max(round(rate * least), 1):,}", _million(even), f"{100 * part:.2g} %",
            f"{1e6 * episode['each']:.2g}", _million(host),
        ])  # fmt: skip
    head = [
        "environment", f"batch from which a step of {1e3 * least:g} ms pays",
        "even price, 10^6 steps/s", f"that as a share of the bound ({peak}, float64)", "new episode on the host, µs",
        "most steps/s for that (10^6)",
    ]  # fmt: skip
    return markdown(head, rows)


def page(found, arguments):
    """All tables, in order."""
    gpu = found.get("device")
    core, price = arguments.core_price, arguments.gpu_price
    return "\n\n".join((
        f"Device: {gpu or NOT_MEASURED + ' (there was none)'}. Millions of environment steps a second, by the number "
        "of environments; CPU: one core, its own time.",
        rates(found, gpu),
        end_to_end(found),
        "Counted work of a control step of one environment, and the millions of steps a second that it allows at most, "
        "in double and in single precision:",
        bounds(found),
        f"Costs, with {core:g} dollars an hour for a core and {price:g} for a GPU:",
        dollars(found, core, price),
        costs(found, core, price, arguments.least),
    ))  # fmt: skip
