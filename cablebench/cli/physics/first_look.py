"""``cablebench first-look``: what a cable circuit's recording shows before any simulation."""

from pathlib import Path
from typing import Annotated, Any

import typer

from cablebench.cli.shared.output import console, print_json


def first_look(
    recording: Annotated[Path, typer.Argument(help="A recording's YAML file, or the folder that holds it.")],
    group: Annotated[str, typer.Option(help="Condition that tells tools or sessions apart.")] = "series",
    load: Annotated[str, typer.Option(help="Condition that holds the load.")] = "load_percent",
    as_json: Annotated[bool, typer.Option("--json", help="The findings as JSON on standard output.")] = False,
) -> None:
    """Distance from a rigid transmission, friction by direction and load, reversals, stiffness, repeatability."""
    from cable_envs.diagnosis.data.first_look import first_look as look
    from cable_envs.diagnosis.data.recording import load_recording

    found = look(load_recording(recording), group, load)
    if as_json:
        print_json(found)
        return
    for name, findings in found.items():
        for line in (f"{name}: {findings['records']} records", *_lines(findings)):
            console().print(line, markup=False)


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
