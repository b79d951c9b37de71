"""A case on disk: the recording folder as an engineer would hand it over, and what its key says of the mismatch."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from cable_envs.proof.rigs import TrueRig

BIN = 0.5
"""s, of the profile that says when the mismatch acts."""

_SHOWN_IN = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}
_UNITS = {
    "position": "m", "velocity": "m/s", "force": "N", "position_reference": "m", "drive_position": "m",
    "drive_velocity": "m/s", "drive_tension": "N", "load_position": "m", "load_tension": "N",
    "drive_velocity_command": "m/s", "drive_angle": "rad", "drive_torque": "N m", "output_angle": "rad",
    "output_torque": "N m", "drive_angle_command": "rad", "time": "s",
}  # fmt: skip


def write_recording(
    folder: Path, rig: TrueRig, claimed: Mapping[str, Any], tables: Sequence[Mapping[str, np.ndarray]], stated: bool,
    digits: int = 8, more: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:  # fmt: skip
    """Write recording.yaml and a table for each record.

    Parameters
    ----------
    folder : Path
        Is made.
    rig : TrueRig
        Says system, preset and noise.
    claimed : mapping
        Name -> (value, std or None where it is known, unit).
    tables : sequence of mapping of str to ndarray
        Columns of the records, SI, "time" first: two to fit, one held out, and perhaps one at rest.
    stated : bool
        Whether the recording states the noise of its channels.
    digits : int
        Of the numbers in the tables.
    more : mapping, optional
        Channel -> further entries of its description.
    """
    folder.mkdir(parents=True, exist_ok=True)
    shown = {name: _SHOWN_IN.get(_UNITS[name], (_UNITS[name], 1.0)) for name in tables[0]}
    for k, table in enumerate(tables, 1):
        columns = np.column_stack([values * shown[name][1] for name, values in table.items()])
        header = ",".join(table)
        np.savetxt(folder / f"run_{k}.csv", columns, delimiter=",", header=header, comments="", fmt=f"%.{digits}g")
    content: dict[str, Any] = {"schema": "cable-recording/1", "system": rig.system}
    if rig.preset:
        content["rig"] = rig.preset
    content["known"] = {n: {"value": v, "unit": u} for n, (v, std, u) in claimed.items() if std is None}
    content["nominal"] = {
        n: {"value": float(f"{v:.6g}"), "std": float(f"{std:.4g}"), "unit": u}
        for n, (v, std, u) in claimed.items()
        if std is not None
    }
    uses = ("fit", "fit", "heldout", "rest")[: len(tables)]
    content["records"] = [{"data": f"run_{k}.csv", "use": use} for k, use in enumerate(uses, 1)]
    content["channels"] = {}
    for name, (unit, factor) in shown.items():
        entry: dict[str, Any] = {"column": name, "unit": unit}
        if name in rig.noise and stated:  # whoever gives a number takes the noise for white
            entry["noise_std"] = float(f"{rig.noise[name] * factor:.4g}")
        content["channels"][name] = entry | dict((more or {}).get(name, {}))
    (folder / "recording.yaml").write_text(yaml.safe_dump(_plain(content), sort_keys=False), encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def profile(left: np.ndarray, at: Sequence[np.ndarray], offsets: Sequence[float]) -> list[list[float]]:
    """[start s, share of the mismatch's energy] of every `BIN` of the fit records, on the recording's clock."""
    energy = (left**2).sum(axis=1)
    total, row, bins = max(energy.sum(), 1e-300), 0, []
    for times, offset in zip(at, offsets, strict=True):
        own = energy[row : row + len(times)]
        row += len(times)
        place = np.floor(times / BIN).astype(int)
        sums = np.bincount(np.maximum(place, 0), weights=own)
        bins += [[round(offset + BIN * k, 6), float(s / total)] for k, s in enumerate(sums)]
    return bins


def concealment(key: Mapping[str, Any], found: Any) -> list[str]:
    """How the effect of a key is concealed, by measure; several may apply. ``found``: what it leaves, or None."""
    if found is None:
        return []
    kinds = []
    if key["absorbed"] > 0.9:
        kinds.append("absorbed_by_refit")
    by = key["excess_by_channel"]
    output, effort = {
        "linear_drive": ("position", "force"),
        "cable_hole": ("load_position", "drive_tension"),
        "pulley_circuit": ("output_angle", "drive_torque"),
    }[key["case"]["system"]]
    if by[output] < 0.33 * by[effort]:
        kinds.append("masked_by_loop")
    shares = np.sort([share for _, share in key["mismatch"]])[::-1]
    if np.searchsorted(np.cumsum(shares), 0.8) + 1 < 0.2 * len(shares):
        kinds.append("brief")
    if key["added"] < 0.03:
        kinds.append("small_in_rms")
    if key["case"]["kind"] == "pair":
        kinds.append("behind_another_effect")
    return kinds


def digest(folder: Path) -> str:
    """Hash of a recording folder's files."""
    total = hashlib.sha256()
    for file in sorted(folder.iterdir()):
        total.update(file.name.encode() + b"\0" + file.read_bytes())
    return total.hexdigest()
