"""``cablebench export-rig``: a rig's law as Python, C, an FMU or a MuJoCo model, for programs without this package."""

from pathlib import Path
from typing import Annotated

import typer

from cablebench.cli.shared.output import console, print_json


def export_rig(
    rig: Annotated[str, typer.Argument(help="A rig file, as the augmented.yaml of a diagnosis, or a preset's name.")],
    out: Annotated[Path, typer.Option(help="The file: .py, .c (its header goes beside it), .fmu or .xml.")],
    form: Annotated[str, typer.Option("--format", help="python, c, fmu (FMI 3.0, co-simulation) or mujoco.")],
    drive: Annotated[
        str | None, typer.Option(help="What the rig is told: an action mode, or follow; default its first mode.")
    ] = None,
    variant: Annotated[
        str, typer.Option(help="analytic, or chain: a circuit of spans and contacts; default as the rig says.")
    ] = "",
    period: Annotated[float, typer.Option(help="Control step, s: how long a command holds.")] = 0.01,
    substeps: Annotated[
        int | None, typer.Option(help="Integration steps in it; default 20, or as many as the rig needs.")
    ] = None,
    start: Annotated[float, typer.Option(help="Position of the output at rest at the start, SI.")] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="What was written, as JSON on standard output.")] = False,
) -> None:
    """Write a rig for other programs, with its effects, from the functions that simulate it here.

    Python and C need no other file. Python, C and an FMU give the numbers of the simulator, to the bit.
    """
    from cable_envs.standalone.export import check_file, export_law
    from cable_envs.standalone.law import law_of

    check_file(form, out)
    law = law_of(
        rig, variant=variant, drive=drive, period=period, substeps=substeps, start=start, name=out.stem
    )  # fmt: skip
    files = export_law(law, form, out)
    inputs = {one.name: one.unit for one in law.inputs}
    if as_json:
        print_json({"format": form, "files": [str(file) for file in files], "plant": law.plant.name,
                    "drive": law.drive, "inputs": inputs, "period": law.period, "substeps": law.substeps})  # fmt: skip
        return
    told = ", ".join(f"{name} ({unit})" for name, unit in inputs.items())
    console().print(f"{law.rig.name} ({law.plant.name}), told: {told}", markup=False)
    console().print(f"control step {law.period:g} s, {law.substeps} integration steps", markup=False)
    for file in files:
        console().print(f"wrote {file}", markup=False)
