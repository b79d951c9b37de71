"""``cablebench identify``: the contact parameters of a cable in a hole from a recording, and how far to trust them."""

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from cable_envs.core.errors import ConfigurationError
from cablebench.cli.shared.arguments import parse_pairs
from cablebench.cli.shared.output import console, print_json


class Method(StrEnum):
    """Optimisers."""

    pso = "pso"
    lsq = "lsq"
    cma = "cma"


class Model(StrEnum):
    """Forms of the tension ratio."""

    g22 = "g22"
    exact = "exact"


PLANT_NAMES = {
    "delta": "extrusion_delta", "mu": "friction_coefficient", "K": "extrusion_gain", "omega": "extrusion_exponent",
}  # fmt: skip
"""Parameter of the ratio -> parameter of the plant, as ``known`` names it."""


def identify(
    recording: Annotated[Path, typer.Argument(help="A recording's YAML file, or the folder that holds it.")],
    method: Annotated[Method, typer.Option(help="Least squares, the paper's swarm, or CMA-ES.")] = Method.lsq,
    model: Annotated[Model, typer.Option(help="Exact ratio, or its expansion, Eq. (22) of Gu 2024.")] = Model.exact,
    seed: Annotated[int, typer.Option(min=0, help="Seed of starting points and swarms.")] = 0,
    bound: Annotated[
        list[str] | None, typer.Option(help="Search range, NAME=[LOW, HIGH] of delta, mu, K, omega; repeatable.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="The result as JSON on standard output.")] = False,
) -> None:
    """Identify delta, mu, K and omega of a cable_hole recording by its tension ratios.

    Needs the channels drive_tension, load_tension (or a known load_mass), drive_velocity (or a position), and
    wrap_angle (or a known one). Parameters under "known" stay fixed, and radius_ratio always does: the ratio contains
    rho0 (1 + delta) only.
    """
    from cable_envs.diagnosis.data.recording import load_recording

    loaded = load_recording(recording)
    result = identify_recording(loaded, method.value, model.value, seed, parse_bounds(bound or ()))
    if as_json:
        print_json(result)
    else:
        _print(result)


def parse_bounds(pairs: Any) -> dict[str, tuple[float, float]]:
    """``["K=[1, 1e5]"]`` as bounds by name."""
    found = {}
    for name, value in parse_pairs(pairs, "--bound").items():
        try:
            low, high = map(float, value)
        except (TypeError, ValueError):
            raise ConfigurationError(f"--bound {name}: expected [LOW, HIGH], got {value!r}") from None
        found[name] = (low, high)
    return found


def identify_recording(
    recording: Any,
    method: str,
    model: str = "exact",
    seed: int = 0,
    bounds: dict[str, tuple[float, float]] | None = None,
) -> dict[str, Any]:
    """What ``--json`` prints. ConfigurationError for a recording that cannot answer."""
    from cable_envs.identification.cma_es import cma_es
    from cable_envs.identification.fit import Fit
    from cable_envs.identification.least_squares import least_squares
    from cable_envs.identification.problem import RatioProblem
    from cable_envs.identification.pso import swarm
    from cable_envs.identification.samples import together

    if recording.system != "cable_hole":
        raise ConfigurationError(
            f"{recording.path}: identify works on cable_hole recordings, this is {recording.system}"
        )
    rho0, origin = radius_ratio(recording)
    fixed = {n: recording.known[p].value for n, p in PLANT_NAMES.items() if p in recording.known} | {"rho0": rho0}
    fit_to = together([record_samples(recording, record) for record in recording.used_for("fit")])
    problem = RatioProblem(
        fit_to.wrap, fit_to.speed, fit_to.ratio, fit_to.noise_std, fixed, model, weighted=True, bounds=bounds or {}
    )
    methods: dict[str, Callable[[RatioProblem, np.random.Generator], Fit]] = {
        "pso": swarm, "lsq": least_squares, "cma": cma_es
    }  # fmt: skip
    fit = methods[method](problem, np.random.default_rng(seed))
    result = {
        "recording": str(recording.path), "method": method, "model": model, "seed": seed, "samples": len(fit_to),
        "left_out": dict(fit_to.left_out), "speed_m_per_s": [float(problem.speed.min()), float(problem.speed.max())],
        "wrap_rad": [float(problem.wrap.min()), float(problem.wrap.max())],
        "parameters": parameter_report(problem, fit, fixed, recording), "cost": fit.cost,
        "chi2_per_degree_of_freedom": fit.cost / max(len(fit_to) - len(problem.free), 1),
        "rms_fit": _rms(problem, fit), "evaluations": fit.evaluations, "seconds": fit.seconds,
        **correlations(problem, fit),
        "above_optimum": above_optimum(problem, fit), "at_bounds": list(fit.at_bounds), "radius_ratio_from": origin,
    }  # fmt: skip
    heldout = [record_samples(recording, record) for record in recording.used_for("heldout")]
    if sum(map(len, heldout)):
        rest = together(heldout)
        other = problem.changed(wrap=rest.wrap, speed=rest.speed, ratio=rest.ratio, noise_std=rest.noise_std)
        result["heldout"] = {"samples": len(rest), "rms": _rms(other, fit)}
    result["notes"] = notes(result)
    return result


def above_optimum(problem: Any, fit: Any) -> float:
    """Chi-square by which least squares improves on the fit when it starts from there; 0 for an optimum."""
    from cable_envs.identification.least_squares import refine

    problem = problem.changed(log_gain=True)
    return max(fit.cost - 2.0 * float(refine(problem, problem.unit(fit.parameters)).cost), 0.0)


def _rms(problem: Any, fit: Any) -> float:
    """Root mean square error of the ratio."""
    residuals = problem.changed(weighted=False).residuals(problem.unit(fit.parameters))
    return float(np.sqrt(np.mean(residuals**2)))


def radius_ratio(recording: Any) -> tuple[float, str]:
    """(rho0, where it is from): given, or from two radii. ConfigurationError without either."""
    for level in ("known", "nominal"):
        if "radius_ratio" in getattr(recording, level):
            return getattr(recording, level)["radius_ratio"].value, level
    radii = [recording.value("hole_radius"), recording.value("cable_radius")]
    if None not in radii:
        return radii[0] / radii[1], "hole_radius / cable_radius"
    if recording.rig is not None:
        return recording.rig.values["radius_ratio"], "rig"
    raise ConfigurationError(
        f"{recording.path}: the ratio of hole to cable radius is needed: 'radius_ratio', or 'hole_radius' and "
        "'cable_radius'"
    )


def record_samples(recording: Any, record: Any) -> Any:
    """Tension ratios of one record, with what the recording knows in place of missing channels."""
    from cable_envs.identification.samples import BlockSettings, derivative, ratio_samples

    recording.require("drive_tension", purpose="identification")
    data, channels, time = record.data, recording.channels, record.time
    if "drive_velocity" in data:
        velocity = data["drive_velocity"]
    else:
        position = next((name for name in ("drive_position", "load_position") if name in data), None)
        if position is None:
            recording.require("drive_velocity", purpose="identification (or drive_position or load_position)")
        velocity = derivative(time, data[position], BlockSettings().seconds)
    load_std = None
    if "load_tension" in data:
        load, load_std = data["load_tension"], channels["load_tension"].noise_std
    elif "load_mass" in recording.known:
        gravity = recording.value("gravity") or 9.81
        load, load_std = np.full(len(time), recording.known["load_mass"].value * gravity), 0.0
    else:
        raise ConfigurationError(
            f"{recording.path}: identification needs the channel load_tension, or load_mass under 'known'"
        )
    if "wrap_angle" in data:
        wrap = data["wrap_angle"]
    elif recording.value("wrap_angle") is not None:
        wrap = np.full(len(time), recording.value("wrap_angle"))
    else:
        raise ConfigurationError(
            f"{recording.path}: identification needs the channel wrap_angle, or wrap_angle under 'known'"
        )
    radius = recording.value("cable_radius")
    return ratio_samples(
        time, velocity, wrap, data["drive_tension"], load,
        drive_std=channels["drive_tension"].noise_std, load_std=load_std,
        rigidity=0.0 if radius is None else recording.value("bending_rigidity") or 0.0,
        radius=1.0 if radius is None else radius * radius_ratio(recording)[0],
    )  # fmt: skip


def parameter_report(problem: Any, fit: Any, fixed: dict[str, float], recording: Any) -> dict[str, Any]:
    """Each parameter with standard deviation and 95 % profile interval; null where the data set no limit."""
    from cable_envs.identification.information import fisher, profile_interval

    std, report = fisher(problem, fit.parameters).std, {}
    for name, value in fit.parameters.items():
        unit = "SI" if name == "K" else "1"
        if name in fixed:
            known = PLANT_NAMES.get(name) in recording.known or "radius_ratio" in recording.known
            report[name] = {"value": value, "unit": unit, "status": "known" if known else "assumed"}
            continue
        interval = profile_interval(problem, fit.parameters, name)
        ends = [None if interval.low_open else interval.low, None if interval.high_open else interval.high]
        spread = std[name] if math.isfinite(std[name]) else None
        report[name] = {"value": value, "unit": unit, "status": "identified", "std": spread, "ci95": ends}
    return report


def correlations(problem: Any, fit: Any) -> dict[str, Any]:
    """Correlation matrix of the estimates and the direction that the data determine worst."""
    from cable_envs.identification.information import fisher

    found = fisher(problem, fit.parameters)
    matrix = [[float(v) if math.isfinite(v) else None for v in line] for line in found.correlation]
    std, direction = found.directions[0]
    return {
        "correlation": {"names": list(found.names), "matrix": matrix},
        "worst_direction": {"relative_std": std if math.isfinite(std) else None, "relative_change": direction},
    }


def notes(result: dict[str, Any]) -> list[str]:
    """What a reader must know before using the numbers."""
    found, parameters = [], result["parameters"]
    if "delta" in parameters and parameters["delta"]["status"] == "identified":
        found.append(
            f"delta holds for rho0 = {parameters['rho0']['value']:g} only ({result['radius_ratio_from']}): the ratio "
            "contains rho0 (1 + delta). "
            "Measure the compressed diameter, or repeat under another load, to separate them."
        )  # fmt: skip
    found += _wide_intervals(parameters)
    found += _correlated(result["correlation"]["names"], result["correlation"]["matrix"])
    if result["chi2_per_degree_of_freedom"] > 2.0:
        found.append(
            f"The model misses the data by {math.sqrt(result['chi2_per_degree_of_freedom']):.1f} times their noise; "
            "the intervals assume it does not."
        )  # fmt: skip
    if result["above_optimum"] > 0.1:
        found.append(
            f"{result['method']} stopped above the optimum: least squares goes on from there by "
            f"{result['above_optimum']:.3g} in "
            f"chi-square. The values are not the best fit; the intervals belong to it."
        )
    if result["at_bounds"]:
        found.append(f"On the edge of the search range: {', '.join(result['at_bounds'])} (--bound).")
    return found


def _wide_intervals(parameters: Mapping[str, Any]) -> list[str]:
    found = []
    for name, p in parameters.items():
        if p["status"] == "identified" and (None in p["ci95"]):
            found.append(f"{name} is not limited by the data within its search range.")
        elif p["status"] == "identified" and p["ci95"][1] - p["ci95"][0] > abs(p["value"]):
            found.append(f"{name} is hardly determined: its 95 % interval is wider than its value.")
    return found


def _correlated(names: Sequence[str], matrix: Sequence[Sequence[float | None]]) -> list[str]:
    pairs = ((a, names[j], matrix[i][j]) for i, a in enumerate(names) for j in range(i))
    return [
        f"{b} and {a} are determined together only (correlation {value:+.3f})."
        for a, b, value in pairs
        if value is not None and abs(value) > 0.95
    ]


def _print(result: dict[str, Any]) -> None:
    from rich.table import Table

    from cable_envs.core.text import number

    out = console()
    low, high = (1e3 * v for v in result["speed_m_per_s"])
    wraps = [math.degrees(w) for w in result["wrap_rad"]]
    out.print(
        f"{result['samples']} tension ratios, {wraps[0]:.0f} to {wraps[1]:.0f} degrees, {low:.3g} to {high:.3g} mm/s; "
        f"{result['method']}, model {result['model']}, {result['evaluations']} evaluations, {result['seconds']:.2f} s",
        markup=False,
    )
    table = Table(box=None, pad_edge=False)
    for name in ("parameter", "value", "unit", "std", "95 % interval", ""):
        table.add_column(name, justify="left" if name in ("parameter", "unit", "") else "right")
    for name, p in result["parameters"].items():
        ends = p.get("ci95")
        text = "" if ends is None else f"{_end(ends[0], number)} to {_end(ends[1], number)}"
        std = number(p["std"], 2) if "std" in p else ""
        table.add_row(name, number(p["value"], 5), "" if p["unit"] == "1" else p["unit"], std, text, p["status"])
    out.print(table)
    rest = f", held out {result['heldout']['rms']:.2g}" if "heldout" in result else ""
    out.print(f"rms error of the ratio: {result['rms_fit']:.2g}{rest}; chi-square per degree of freedom "
              f"{result['chi2_per_degree_of_freedom']:.2f}", markup=False)  # fmt: skip
    for note in result["notes"]:
        out.print(f"- {note}", markup=False, style="dim")


def _end(value: float | None, number: Any) -> str:
    return "no end" if value is None else number(value, 4)
