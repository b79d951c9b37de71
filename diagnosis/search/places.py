"""Where the mismatch of a diagnosis is, channel by channel and record by record: `fit.locate` on its traces."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cable_envs.diagnosis.fit import locate
from cable_envs.diagnosis.fit.likelihood import Judged
from cable_envs.diagnosis.model.model import Coordinate, Model
from cable_envs.diagnosis.model.rest import AnyNoise
from cable_envs.diagnosis.model.verdict import Trace
from cable_envs.diagnosis.search.selection import Selection


def located(
    ways: tuple[str, str], traces: Sequence[Trace], selection: Selection, named: bool, nothing: bool
) -> tuple[list[dict[str, Any]], tuple[Trace, ...]]:
    """(entries of the verdict's location, the largest first; the traces with their shaded intervals).

    The mismatch is the difference of the two predictions where an effect is named, else what the refit leaves, in the
    held-out records too: they may be all that shows it. A recording with nothing wrong has no location.
    """
    if nothing:
        return [], tuple(traces)
    noise = selection.final.whitener.noise
    energies = {id(t): _energy(t, named, noise[t.channel]) for t in traces}
    asked = [t for t in traces if t.use == "fit" or not named]
    total = sum(float(energies[id(t)].sum()) for t in asked)
    if total <= 0.0:
        return [], tuple(traces)
    entries, spans_of = [], {}
    for channel in dict.fromkeys(t.channel for t in asked):
        own = [t for t in asked if t.channel == channel]
        share = sum(float(energies[id(t)].sum()) for t in own) / total
        if share < locate.LEAST_CHANNEL:
            continue
        found, text = _regime(ways, own, np.concatenate([energies[id(t)] for t in own]))
        for t in own:
            energy = energies[id(t)]
            spans, held = locate.intervals(t.time, energy)
            if energy.sum() < 0.01 * total:
                continue
            spans_of[id(t)] = tuple((a, b) for a, b in spans)
            entries.append({
                "channel": channel, "record": t.record, "regime": found.coordinate if found else "everywhere",
                "where": _sentence(channel, t.record, text, found, share), "intervals_s": spans,
                "share_of_excess": held, "share_of_all": float(energy.sum() / total), "in_words": text,
                "range": [found.low, found.high] if found else None, "unit": found.unit if found else "",
                "energy_in_regime": found.energy if found else 1.0, "time_in_regime": found.time if found else 1.0,
            })  # fmt: skip
    for t in traces:
        if t.use != "fit" and any(e["channel"] == t.channel for e in entries):
            spans_of[id(t)] = tuple((a, b) for a, b in locate.intervals(t.time, energies[id(t)])[0])
    shaded = tuple(replace(t, shaded=spans_of.get(id(t), ())) for t in traces)
    return sorted(entries, key=lambda e: -e["share_of_all"]), shaded


def _energy(trace: Trace, named: bool, noise: AnyNoise) -> np.ndarray:
    if named:
        d = (trace.augmented - trace.refit) / trace.noise
        return np.where(np.isfinite(d), d, 0.0) ** 2
    period = float(np.median(np.diff(trace.time)))
    d = locate.smooth((trace.measured - trace.refit) / trace.noise, trace.good, period)
    width = max(round(locate.SMOOTHED / period), 1)
    # of a moving mean of the noise, taken as what the channel has without a mismatch
    of_noise = (noise.of_mean(width) / trace.noise) ** 2
    return np.where(trace.good, np.maximum(d**2 - of_noise, 0.0), 0.0)


def _regime(ways: tuple[str, str], own: Sequence[Trace], energy: np.ndarray) -> tuple[locate.Regime | None, str]:
    names = [n for n in own[0].along if all(n in t.along for t in own)]
    joined = {n: Coordinate(n, own[0].along[n][0], np.concatenate([t.along[n][1] for t in own])) for n in names}
    since = np.concatenate([t.time - t.time[0] for t in own])
    joined[locate.ELAPSED] = Coordinate(locate.ELAPSED, "s", since)
    found = locate.regime(list(joined.values()), energy)
    return found, locate.words(found, ways, joined)


def _sentence(channel: str, record: str, text: str, found: locate.Regime | None, share: float) -> str:
    name = channel.replace("_", " ")
    if found is None:
        return f"{name} of {record}: {text}. {share:.0%} of the mismatch is in this channel"
    return (
        f"{name} of {record}: {text}. That is {found.time:.0%} of the time and {found.energy:.0%} of this channel's "
        f"mismatch. {share:.0%} of the whole mismatch is in this channel"
    )


def permuted(model: Model, null: Judged, final: Judged, rng: np.random.Generator) -> list[dict[str, Any]]:
    """p-values by block permutation of every channel and coordinate, of what the refit and the last model leave."""
    results: list[Mapping[tuple[str, str], float]] = []
    for judged in (null, final):
        white = judged.whitener.flat(model.blocks, judged.raw)
        results.append(locate.clues(model.blocks, white, rng))
    before, after = results
    return [
        {"channel": c, "coordinate": n, "p_before": p, "p_after": after[c, n]} for (c, n), p in before.items()
    ]  # fmt: skip
