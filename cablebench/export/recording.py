"""Episodes as a recording of a rig: the format ``cable-recording/1`` that `cable_envs.diagnosis.data.recording` reads.

A folder with recording.yaml, one table (CSV or Parquet) for each episode and, where the rig is no preset, its file
under rig/. The tables hold what sensors read (with the noise and delay of the environment), the reference, and the
command in the row from whose time on it acted, held until the next row: enough to replay the episode. The last row
repeats the last command.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import yaml

from cable_envs.core.errors import ConfigurationError, nearest
from cable_envs.core.files import require_writable
from cable_envs.diagnosis.data.description import channels_of, parameters_of
from cable_envs.diagnosis.data.writing import FILE, SCHEMA, TABLES, move, rig_entry, staging, undo
from cable_envs.plants import family, variant_of
from cable_envs.sim.rigs import Rig
from cable_envs.sim.setup import Setup
from cablebench.entrants.entrant import Entrant
from cablebench.export.trace import Trace, measured
from cablebench.run.evaluation import core_of, env_id_of

UNTOLD = "Simulated rig; what it has beyond the rig that is stated is not told."
"""Description of a recording of a concealed rig."""


def check_environment(setup: Setup) -> None:
    """ConfigurationError where episodes of ``setup`` do not fit the format: other rigs each time, or no such system."""
    if setup.randomize:
        raise ConfigurationError(
            "a recording describes one rig, and 'randomize' draws another for every episode: choose the parameters "
            "with --option rig={name: value}"
        )
    system = setup.rig.plant
    commands = family(system).commands
    if setup.action_mode.name not in commands:
        known = [f"{system} in mode {mode}" for mode in commands]
        asked = f"{system} in mode {setup.action_mode.name}"
        raise ConfigurationError(f"recordings of {asked} are not known; {nearest(asked, known)}")


def check_split(episodes: int, heldout: int | None) -> int:
    """How many of ``episodes`` (the last ones) are held out: ``heldout``, by default a quarter, one at least if two."""
    if heldout is None:
        return max(round(episodes / 4), 1) if episodes > 1 else 0
    if not 0 <= heldout < episodes:
        raise ConfigurationError(f"{heldout} of {episodes} episodes held out: at least one must be left to fit")
    return heldout


def write_recording(
    traces: Sequence[Trace], full: gym.Env, entrant: Entrant, folder: Path, *, table: str = "csv", heldout: int = 0,
    believed: Rig | None = None,
) -> Path:  # fmt: skip
    """Write ``traces`` to ``folder``; the last ``heldout`` are marked so. Returns the YAML file, which is written last.

    ``full``: the traces' environment made anew with ``observe="full"``; ``believed``: the rig that the recording states
    in the place of the true one, of which it then tells nothing. Raises ConfigurationError where the folder holds a
    recording, and for what `check_environment` names.
    """
    setup = core_of(full).setup
    check_environment(setup)
    if table not in TABLES:
        raise ConfigurationError(f"unknown table format '{table}'; {nearest(table, TABLES)}")
    check_folder(folder)
    records: list[dict[str, str]] = []
    files: dict[str, bytes] = {}
    for k, trace in enumerate(traces):
        name = f"episode_{trace.seed}.{table}"
        columns = channel_columns(setup, trace, measured(full, trace))
        files[name] = _csv(columns).encode() if table == "csv" else _parquet(columns)
        records.append({"data": name, "use": "heldout" if k >= len(traces) - heldout else "fit"})
    stated = setup.rig if believed is None else believed
    plain = replace(stated, effects={}, own=(), variant=variant_of(setup.plant.name))  # what it has more is not told
    rig, rig_file = rig_entry(plain)
    if rig_file is not None:
        files[rig] = rig_file.encode()
    system = setup.rig.plant
    channels = {name: channel_entry(setup, name) for name in columns}
    channels[family(system).commands[setup.action_mode.name]]["hold"] = "step"
    content = {
        "schema": SCHEMA,
        "description": _description(full, entrant, traces) if believed is None else UNTOLD,
        "system": system,
        "rig": rig,
        "known": _parameters(stated, family(system).known),
        "nominal": _parameters(stated, family(system).nominal),
        "records": records,
        "channels": channels,
    }
    files[FILE] = yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=120).encode()
    with staging(folder) as stage:
        for name, text in files.items():
            (stage / name).parent.mkdir(exist_ok=True)
            (stage / name).write_bytes(text)
        move(stage, folder)
    return folder / FILE


def check_folder(folder: Path) -> None:
    """ConfigurationError where ``folder`` holds a recording already, or cannot be written to."""
    require_writable(folder)
    undo(folder)
    found = sorted(p.name for p in folder.glob("*.y*ml")) if folder.is_dir() else []
    if found:
        raise ConfigurationError(f"{folder} holds {found[0]}: choose another folder, a recording's holds one YAML file")


def channel_columns(setup: Setup, trace: Trace, sensors: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The recording's channels in SI, [n + 1] each: time, every measured channel of the system, reference, command."""
    system = setup.rig.plant
    n = len(trace.infos["time"])
    columns = {"time": trace.infos["time"]}
    told = family(system)
    for name in channels_of(system):
        signal = told.signals.get(name, name)
        if signal in sensors:
            columns[name] = sensors[signal]
    if "wrap_angle" in channels_of(system) and setup.rig.holes == 1:
        columns["wrap_angle"] = np.full(n, trace.rig["wrap_angle"])
    columns[told.output(setup.task.kind).reference] = trace.infos["reference"]
    # info["command"] is what acted in the step that ended; a row holds what acts from its time on
    command = trace.infos["command"]
    columns[told.commands[setup.action_mode.name]] = np.append(command[1:], command[-1])
    return columns


def channel_entry(setup: Setup, name: str) -> dict[str, Any]:
    """A channel's entry in the YAML: in SI, with the noise that its sensor has."""
    system = setup.rig.plant
    entry: dict[str, Any] = {"column": name, "unit": channels_of(system)[name]}
    signal = family(system).signals.get(name, name)
    rows = [s.name for s in setup.plant.signals]
    if signal in rows and setup.noise[rows.index(signal)] > 0.0:
        entry["noise_std"] = float(setup.noise[rows.index(signal)])
    return entry


def _parameters(rig: Rig, names: Sequence[str]) -> dict[str, Any]:
    values = dict(rig.values)
    if "radius_ratio" in values and "cable_radius" in values:
        values["hole_radius"] = values["radius_ratio"] * values["cable_radius"]
    table = parameters_of(rig.plant)
    return {name: {"value": float(values[name]), "unit": table[name].unit} for name in names}


def _description(env: gym.Env, entrant: Entrant, traces: Sequence[Trace]) -> str:
    setup = core_of(env).setup
    late = f", measured {setup.sensor_delay} control steps late" if setup.sensor_delay else ""
    effects = ", ".join(f"{name} = {value:g}" for name, value in setup.rig.effects.items())
    more = f" The rig had effects that its entry here does not tell: {effects}." if effects else ""
    return (
        f"Simulated: {len(traces)} episodes of {entrant.title} on {env_id_of(env)}{late}. "
        f"A row holds the command that acts from its time until the next row.{more}"
    )


def _csv(columns: Mapping[str, np.ndarray]) -> str:
    """Shortest decimals that read back as the same float64; an empty cell for what is not finite."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*(c.tolist() for c in columns.values()), strict=True):
        writer.writerow([repr(v) if np.isfinite(v) else "" for v in row])
    return text.getvalue()


def _parquet(columns: Mapping[str, np.ndarray]) -> bytes:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise ConfigurationError("Parquet needs pyarrow: pip install 'cable-envs[parquet]'") from error
    buffer = io.BytesIO()
    table = {name: np.where(np.isfinite(values), values, np.nan) for name, values in columns.items()}
    pyarrow.parquet.write_table(pyarrow.table(table), buffer)
    return buffer.getvalue()
