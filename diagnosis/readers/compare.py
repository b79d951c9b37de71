"""Records side by side: one that does not belong to the others of its tool is named, not mixed in."""

from collections.abc import Mapping, Sequence

import numpy as np

from cable_envs.diagnosis.readers.base import Fault, RecordSpec
from cable_envs.diagnosis.readers.checks import Summary
from cable_envs.diagnosis.readers.split import plain

RATIO_SHARE, OFFSET_TRAVEL, SHORT = 0.05, 0.15, 0.5
"""A record is an outlier when its ratio differs from its group's median by 5 %, or its offset by 15 % of the output's
travel, and by six times the usual difference; short, when it lasts half as long as usual."""


def outliers(
    records: Sequence[RecordSpec], summaries: Mapping[str, Summary], group: str | None, resets: bool
) -> dict[str, list[Fault]]:
    """Doubts by record name: transmission unlike that of the group's other records, and much shorter ones.

    ``resets``: the encoders' zero differs between records anyway, so that only the ratio counts.
    """
    groups: dict[str, list[RecordSpec]] = {}
    for record in records:
        key = str(plain(record.conditions[group])) if group and group in record.conditions else ""
        groups.setdefault(key, []).append(record)
    found: dict[str, list[Fault]] = {record.name: [] for record in records}
    for key, members in groups.items():
        named = f"{group} {key}" if key else "this set"
        for name, fault in _unlike(members, summaries, named, resets):
            found[name].append(fault)
    lengths = {r.name: summaries[r.name].end - summaries[r.name].start for r in records}
    usual = float(np.median(list(lengths.values())))
    for record in records:
        if lengths[record.name] < SHORT * usual:
            text = f"lasts {lengths[record.name]:.4g} s where the others last {usual:.4g} s: cut off?"
            found[record.name].append(Fault(record.file, "outlier", text))
    return found


def _unlike(
    members: Sequence[RecordSpec], summaries: Mapping[str, Summary], named: str, resets: bool
) -> list[tuple[str, Fault]]:
    known = [(r, summaries[r.name]) for r in members if summaries[r.name].ratio is not None]
    if len(known) < 2:
        return []
    found = []
    ratios = np.array([s.ratio for _, s in known])
    offsets = np.array([s.offset for _, s in known])
    for what, values, floor in (
        ("ratio of output to drive", ratios, RATIO_SHARE * abs(np.median(ratios))),
        ("zero of the output angle against the drive's", offsets, OFFSET_TRAVEL * _travel(known)),
    ):
        if what.startswith("zero") and resets:
            continue
        centre = np.median(values)
        spread = np.median(np.abs(values - centre))
        far = np.abs(values - centre) > max(floor, 6.0 * spread if len(values) > 3 else 0.0)
        if not far.any():
            continue
        several = len(values) < 3 or far.sum() > len(values) // 2
        for (record, _), value, odd in zip(known, values, far):
            if odd or several:
                text = (
                    f"{what} is {value:.4g}, in the others of {named} {_others(values, value)}: "
                    "another tool, another session, or records swapped?"
                )
                found.append((record.name, Fault(record.file, "outlier", text)))
    return found


def _others(values: np.ndarray, value: float) -> str:
    rest = values[values != value]
    low, high = rest.min(), rest.max()
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _travel(known: Sequence[tuple[RecordSpec, Summary]]) -> float:
    """Median travel of the output, SI."""
    return float(np.median([s.travel for _, s in known]))
