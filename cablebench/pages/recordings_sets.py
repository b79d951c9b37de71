"""Each set of real recordings as numbers (JSON) and figures (SVG): what the page of `cablebench real-data` shows."""

from collections.abc import Callable, Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Any

import numpy as np

from cable_envs.diagnosis.model.verdict import Trace
from cable_envs.diagnosis.real.finding import Finding, pick
from cablebench.pages import recordings_figures as draw

Tell = Callable[[str], None]
Made = tuple[dict[str, Any], dict[str, str]]
"""(numbers, figure's name -> SVG)."""
_CURVES = {"measured": "measured", "nominal": "refit", "final": "augmented"}
"""Curve of a figure -> field of `Trace`."""


def numbers(finding: Finding) -> dict[str, Any]:
    """A finding without its curves."""
    return finding.as_json()


def band_brake(shared: Path, work: Path, tell: Tell) -> Made:
    """Load-dependent slip, backlash and pre-sliding; a viscous answer beside."""
    from cable_envs.diagnosis.real.band_brake import band_brake as study
    from cable_envs.diagnosis.real.sets import imported

    found = study(imported("band-brake", shared, work), tell)
    finding = found.finding
    force, pull = pick(finding.traces, "force", "heldout")[0], _last(finding, "heldout")
    second = force.time > force.time.mean()  # the full strokes, once
    panels = [
        _loop(t, second, title, label)
        for t, title, label in (
            (force, "Force, held-out record (1 Hz)", "force  [kN]"),
            (pull, "Difference of the band's tensions", "T2 - T1  [kN]"),
        )
    ]
    steps = [(s.hypothesis.name, s.fit, s.heldout) for s in finding.steps]
    figures = {
        "loops": draw.loops(panels),
        "ladder": draw.ladder(
            steps, {"force": ("Error of the force  [N]", 1.0), pull.channel: ("Error of T2 - T1  [N]", 1.0)}
        ),
        "alone": _alone(finding, "force", "error of the force, 1 Hz held out  [kN]; dot: 0.5 Hz, fitted"),
        "alone_pull": _alone(finding, pull.channel, "error of T2 - T1, 1 Hz held out  [kN]; dot: 0.5 Hz, fitted"),
    }
    return {"finding": numbers(finding), "viscous_last": found.viscous_last}, figures


def _alone(finding: Finding, channel: str, label: str) -> str:
    rows = [(a.hypothesis.name, a.heldout[channel] / 1e3, a.fit[channel] / 1e3) for a in finding.alone]
    return draw.bars(sorted(rows, key=lambda r: r[1]), label, finding.steps[0].heldout[channel] / 1e3, {})


def _last(finding: Finding, use: str) -> Trace:
    return next(t for t in finding.traces if t.use == use and t.channel != "force")


def _loop(trace: Trace, part: np.ndarray, title: str, label: str) -> dict[str, Any]:
    part = part & (trace.time < trace.time[part][0] + 2.2)
    return {
        "title": title, "xlabel": "displacement  [mm]", "ylabel": label, "x": 1e3 * trace.along["position"][1][part],
        **{k: 1e-3 * getattr(trace, of)[part] for k, of in _CURVES.items()},
    }  # fmt: skip


def emps(shared: Path, work: Path, tell: Tell) -> Made:
    """Mass, friction and offset with intervals beside the published ones."""
    from cable_envs.diagnosis.real.emps import PUBLISHED, UNITS
    from cable_envs.diagnosis.real.emps import emps as study
    from cable_envs.diagnosis.real.sets import imported

    found = study(imported("emps", shared, work), tell)
    words = {"steps": "diagnosis", "coloured": "taken for noise", "inverse": "inverse dynamics"}
    titles = {"mass": "M", "viscous": "Fv", "coulomb": "Fc", "force_offset": "offset"}
    panels = [
        {
            "title": f"{titles[name]}  [{UNITS[name]}]", "published": value,
            "rows": [(words[m], *astuple(e[name])[:3]) for m, e in _in_order(found.estimates, words)],
        }
        for name, value in PUBLISHED.items()
    ]  # fmt: skip
    trace = pick(found.finding.traces, "position", "heldout")[0]
    speed = trace.along["speed"][1]
    zero = np.zeros_like(trace.time)
    run = {
        "title": "Held-out record: measured position less predicted", "ylabel": "error  [mm]", "time": trace.time,
        "measured": zero, "nominal": 1e3 * (trace.measured - trace.refit),
        "final": 1e3 * (trace.measured - trace.augmented),
    }  # fmt: skip
    close = {
        **run,
        "title": "The same, nearer: what remains follows the speed's steps",
        "nominal": np.full(len(zero), np.nan),
    }
    steps = [(s.hypothesis.name, s.fit, s.heldout) for s in found.finding.steps]
    figures = {
        "intervals": draw.intervals(panels),
        "left": draw.runs([run, close], shared=True),
        "ladder": draw.ladder(steps, {"position": ("Error of the position  [um]", 1e6)}),
    }
    left = trace.measured - trace.augmented
    moving = np.abs(speed) > 0.02 * np.abs(speed).max()
    return {
        "finding": numbers(found.finding), "published": PUBLISHED, "units": UNITS,
        "estimates": {m: {n: e.as_json() for n, e in of.items()} for m, of in found.estimates.items()},
        "left_um": {
            "moving": 1e6 * float(np.sqrt(np.mean(left[moving] ** 2))),
            "at rest and reversals": 1e6 * float(np.sqrt(np.mean(left[~moving] ** 2))) if (~moving).any() else None,
        },
    }, figures  # fmt: skip


def _in_order(estimates: Mapping[str, Any], names: Mapping[str, str]) -> list[tuple[str, Any]]:
    return [(m, estimates[m]) for m in names if m in estimates]


def coupled_drives(shared: Path, work: Path, tell: Tell) -> Made:
    """Free run on the official split; the sensor's rectification against friction."""
    from cable_envs.diagnosis.real.coupled_drives import PUBLISHED
    from cable_envs.diagnosis.real.coupled_drives import coupled_drives as study
    from cable_envs.diagnosis.real.sets import imported

    found = study(imported("coupled-drives", shared, work), tell)
    uniform, prbs = found.findings["uniform"], found.findings["PRBS"]
    panels = [_joined(uniform, name, 4.0) for name in ("uniform_1", "uniform_2")]
    panels.append(_joined(prbs, "prbs_1", 4.0))
    base = uniform.steps[0].heldout["speed_reading"]
    alone = [(_plain(a.hypothesis.name), a.heldout["speed_reading"], a.fit["speed_reading"]) for a in uniform.alone]
    alone.sort(key=lambda r: r[1])
    marks = {"nets": 0.095}
    steps = {n: [(s.hypothesis.name, s.fit, s.heldout) for s in f.steps] for n, f in found.findings.items()}
    figures = {
        "runs": draw.runs(panels),
        "ladder": draw.ladder(steps["uniform"], {"speed_reading": ("Uniform records: error of the reading  [V]", 1.0)}),
        "ladder_prbs": draw.ladder(steps["PRBS"], {"speed_reading": ("PRBS records  [V]", 1.0)}),
        "alone": draw.bars(alone, "free-run error on the test samples  [V]; dot: fitted samples", base, marks),
    }
    return {
        "findings": {n: numbers(f) for n, f in found.findings.items()}, "published": PUBLISHED,
        "test": {name: {"naive": pair[0], "named": pair[1]} for name, pair in found.test.items()},
    }, figures  # fmt: skip


def _plain(name: str) -> str:
    return name.removesuffix(".speed_reading")


def _joined(finding: Finding, name: str, since: float) -> dict[str, Any]:
    """A record from ``since`` s on, its held-out end included."""
    parts = [t for t in finding.traces if t.record.startswith(name)]
    parts.sort(key=lambda t: t.time[0])
    time = np.concatenate([t.time for t in parts])
    late = time >= since
    curves = {
        k: np.concatenate([getattr(t, of) for t in parts])[late] for k, of in _CURVES.items()
    }  # fmt: skip
    return {
        "title": name.replace("_", " "), "ylabel": "reading  [V]", "time": time[late], "from_test": parts[-1].time[0],
        **curves,
    }  # fmt: skip


def da_vinci(shared: Path, work: Path, tell: Tell) -> Made:
    """The jaw: `diagnosis.real.davinci_study.study`, as it is; the page draws its figures from the numbers."""
    from cable_envs.diagnosis.real.davinci_study import rounded, study
    from cable_envs.diagnosis.real.sets import imported

    recording = imported("da-vinci-jaw", shared, work)
    return rounded(study(recording.path.parent, tell)), {}


def servo_pendulum(shared: Path, work: Path, tell: Tell) -> Made:
    """The ladder on every split beside the peers' friction models, and a held-out run."""
    from cable_envs.diagnosis.real import servo_pendulum as study
    from cable_envs.diagnosis.real.sets import imported

    found = study.servo_pendulum(imported("servo-pendulum", shared, work), tell)
    panels = []
    for split, run in study.FIGURE:
        first, last = (found.splits[split][k].curves[run] for k in (0, -1))
        panels.append({
            "title": f"{run.replace('_', ' ')}, fitted on the other gain", "ylabel": "angle  [rad]", "time": first.time,
            "measured": first.measured, "nominal": first.predicted, "final": last.predicted,
        })  # fmt: skip
    rungs = {name: [rung.as_json() for rung in ladder] for name, ladder in found.splits.items()}
    return {
        "splits": rungs, "steps": study.glance(rungs), "peers": study.PEERS, "finding": numbers(found.finding),
    }, {"runs": draw.runs(panels, shared=True)}  # fmt: skip


SETS: Mapping[str, Callable[[Path, Path, Tell], Made]] = {
    "da-vinci-jaw": da_vinci, "band-brake": band_brake, "emps": emps, "coupled-drives": coupled_drives,
    "servo-pendulum": servo_pendulum,
}  # fmt: skip
