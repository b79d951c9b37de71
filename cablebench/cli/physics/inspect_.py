"""``cablebench inspect``: what is in a recording, and what a cable circuit's shows before any simulation."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from cablebench.cli.shared.output import console, print_json


def inspect(
    recording: Annotated[
        Path,
        typer.Argument(help="A recording's YAML file, or the folder that holds it; with --systems also a mapping."),
    ],
    group: Annotated[str, typer.Option(help="Circuit: condition that distinguishes tools or sessions.")] = "series",
    load: Annotated[str, typer.Option(help="Circuit: condition that holds the load.")] = "load_percent",
    systems: Annotated[
        bool, typer.Option("--systems", help="Which systems its channels fit, and what each would assume.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="The findings as JSON on standard output.")] = False,
) -> None:
    """Show a recording's records, channels and gaps; of a cable circuit also its friction, stiffness and reversals.

    Nothing is simulated: of a circuit whose drive and output were both recorded it says how far it is from a rigid
    transmission, and where.
    """
    if systems:
        _show_systems(recording, as_json)
        return
    from cable_envs.diagnosis.data.first_look import NEEDS, first_look
    from cable_envs.diagnosis.data.overview import overview
    from cable_envs.diagnosis.data.recording import load_recording

    loaded = load_recording(recording)
    found: dict[str, Any] = {"recording": overview(loaded)}
    if loaded.system == "pulley_circuit" and set(NEEDS) <= set(loaded.channels):
        found["circuit"] = first_look(loaded, group, load)
    if as_json:
        print_json(found)
        return
    _print_overview(found["recording"], console())
    for name, findings in found.get("circuit", {}).items():
        for line in (f"{name}: {findings['records']} records", *_lines(findings)):
            console().print(line, markup=False)


def _show_systems(recording: Path, as_json: bool) -> None:
    """Which systems fit; of the first one that does, every number that would be assumed."""
    from dataclasses import asdict

    from cable_envs.diagnosis.systems.stated.fitting import systems_for
    from cable_envs.diagnosis.systems.stated.origins import in_words

    found = systems_for(recording)
    if as_json:
        print_json([asdict(fit) for fit in found])
        return
    out = console()
    for fit in found:
        counts = {s: sum(p.status == s for p in fit.parameters) for s in ("stated", "fitted", "assumed")}
        said = "fits" if fit.fits else f"missing: {in_words(fit.missing)}"
        numbers = ", ".join(f"{count} {status}" for status, count in counts.items() if count)
        ask = f"state {', '.join(fit.asks)} unless its controller can be replayed" if fit.asks else ""
        out.print(f"{fit.system}: {'; '.join(part for part in (said, ask, numbers, fit.note) if part)}", markup=False)
        taken = ", ".join(f"{channel} = {own}" for channel, own in fit.channels.items() if channel != own)
        if fit.fits and taken:
            out.print(f"  with {taken}", markup=False)
    first = next((fit for fit in found if fit.fits and fit.parameters), None)
    if first is not None:
        out.print(f"{first.system}, numbers:", markup=False)
        for p in sorted(first.parameters, key=lambda p: ("stated", "fitted", "assumed").index(p.status)):
            out.print(f"  {p.status}: {p.name} {p.value:.4g} {p.unit} ({p.source})", markup=False)


def _print_overview(seen: Mapping[str, Any], out: Any) -> None:
    from rich.table import Table

    from cable_envs.core.text import number

    out.print(f"{seen['system']}: {seen['description']}" if seen["description"] else seen["system"], markup=False)
    records = Table(box=None, pad_edge=False)
    for name in ("record", "use", "samples", "s", "Hz", "gaps", "in doubt"):
        records.add_column(name, justify="left" if name in ("record", "use") else "right")
    for r in seen["records"]:
        records.add_row(
            r["name"], r["use"], str(r["samples"]), number(r["seconds"]), number(r["rate"]), str(r["gaps"]),
            str(r["doubts"]),
        )  # fmt: skip
    channels = Table(box=None, pad_edge=False)
    for name in ("channel", "unit", "from", "to", "noise"):
        channels.add_column(name, justify="left" if name in ("channel", "unit") else "right")
    for c in seen["channels"]:
        channels.add_row(c["name"], c["unit"], number(c["low"]), number(c["high"]), number(c["noise_std"]))
    out.print(records, "", channels, sep="\n")
    for title in ("known", "nominal"):
        if seen[title]:
            values = ", ".join(f"{name} {number(value)}" for name, value in seen[title].items())
            out.print(f"{title} (SI): {values}", markup=False)


def _lines(found: dict[str, Any]) -> list[str]:
    rigid, near, repeats = found["rigid"], found["reversals"], found["repeats"]
    lines = [
        f"  rigid: ratio {rigid['ratio']:.3f}; misses the jaw's angle by {rigid['angle_rms_deg']:.2f} deg "
        f"(closing {rigid['closing_angle_rms_deg']:.2f}, a line for each record "
        f"{rigid['each_record_angle_rms_deg']:.2f}) and its torque by {rigid['torque_rms_mnm']:.0f} mN m "
        f"(closing {rigid['closing_torque_rms_mnm']:.0f})"
    ]
    for s in found["slopes"]:
        ln_n = "none" if s["ln_n"] is None else f"{s['ln_n']:.3f}"
        at = "" if s["frequency"] is None else f" at {s['frequency']:g} Hz"
        lines.append(
            f"  torque across loads{at}: slope {s['closing']:.2f} closing, {s['opening']:.2f} opening, ln n {ln_n}; "
            f"without load {s['gap_mnm']:.0f} mN m apart"
        )
    lines.append(
        f"  near reversals ({100 * near['share']:.0f} % of samples): {near['by_sign_mnm']:.0f} mN m by direction "
        f"({near['by_sign_elsewhere_mnm']:.0f} elsewhere), {near['by_state_mnm']:.0f} with a state that follows over "
        f"{near['length_deg']:.1f} deg ({near['by_state_elsewhere_mnm']:.0f} elsewhere)"
    )
    for way, steps in found["stiffness"].items():
        if steps:
            text = ", ".join(f"{s['from']:g}-{s['to']:g}: {s['n_m_per_rad']:.2f}" for s in steps)
            lines.append(f"  stiffness at the jaw between loads, {way}, N m/rad: {text}")
    lines.append(
        f"  repeats from stroke to stroke: {repeats['jaw_deg']:.2f} deg, {repeats['jaw_torque_mnm']:.1f} mN m at the "
        f"jaw, {repeats['torque_mnm']:.1f} mN m at the motor"
    )
    return lines
