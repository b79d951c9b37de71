"""Coupled electric drives (Wigren and Schoukens 2017): from the naive simulator to what the reading asks for.

Naive: two inertias, a belt, viscous friction, and a sensor that shows the pulley's speed. The official split: 400
samples to fit, 100 to test, run freely from the start of each record with the voltage alone.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cable_envs.diagnosis.data.recording import Recording
from cable_envs.diagnosis.model.verdict import Trace
from cable_envs.diagnosis.real.finding import Finding, find

GROUPS = {"uniform": "uniform_", "PRBS": "prbs_"}
PUBLISHED = {"recurrent net, GP-NARX": (0.10, 0.09), "linear": (0.29, 0.33)}
"""Free-run RMSE on the last 100 samples of the two uniform records, V."""


@dataclass(frozen=True)
class CoupledDrives:
    """``findings`` by group of records; ``test``: free-run RMSE, V, of the naive and the last model by test record."""

    findings: Mapping[str, Finding]
    test: Mapping[str, tuple[float, float]]


def coupled_drives(recording: Recording, tell: Callable[[str], None] = lambda text: None) -> CoupledDrives:
    """Both groups of records, each by itself: their sensors have different gains."""
    findings, test = {}, {}
    for name, prefix in GROUPS.items():
        records = tuple(r for r in recording.records if r.name.startswith(prefix))
        tell(f"coupled drives, {name}: {len(records)} records")
        findings[name] = find(name, replace(recording, records=records), tell=tell)
        for trace in findings[name].traces:
            if trace.use == "heldout":
                test[trace.record.split("_after")[0]] = (_rms(trace, trace.refit), _rms(trace, trace.augmented))
    return CoupledDrives(findings, test)


def _rms(trace: Trace, prediction: np.ndarray) -> float:
    return float(np.sqrt(np.mean((trace.measured - prediction) ** 2)))
