"""Everything that is shown of the da Vinci jaw, as one dictionary of numbers: what `docs/recordings` keeps.

cablebench import da-vinci-jaw ../shared/recordings/davinci_tool --out jaw
python -m cable_envs.diagnosis.real.davinci_study jaw docs/recordings/davinci.json.xz
"""

import sys
from pathlib import Path
from typing import Any, cast

from cable_envs.core.files import packed_json
from cable_envs.diagnosis.fit.weights import effective_samples
from cable_envs.diagnosis.real.davinci import (
    Tell,
    ablations,
    diagnosed,
    load,
    parameters,
    pitch,
    steps_table,
)
from cable_envs.diagnosis.real.davinci_elsewhere import elsewhere
from cable_envs.diagnosis.real.davinci_splits import PUBLISHED, compare
from cable_envs.diagnosis.real.feedforward import replayed, traces
from cable_envs.diagnosis.real.finding import inside, named_again
from cable_envs.diagnosis.systems.transmission import TransmissionModel
from cable_envs.diagnosis.systems.transmission_effects import candidates

SHOWN = "Tool_4_Maryland_L_4_24.csv"
"""The record of the figures: 50 % load at 0.3 Hz, held out."""


def study(folder: Path | str, tell: Tell = lambda text: None, controls: bool = True) -> dict[str, Any]:
    """Steps of the search, parameters, ablations, comparison, feedforward, wrist pitch, and traces of one record.

    ``folder``: the imported data set. ``controls``: with the neighbours and networks. About five minutes.
    """
    recording = load(folder)
    whole = diagnosed(recording, tell)
    steps, refused = whole.diagnosis.steps, dict(whole.selection.refused)
    heldout = cast(TransmissionModel, whole.question.heldout)
    naive, full = whole.selection.null.fit, whole.selection.final.fit
    uses = {"naive": naive.values, "augmented": full.values}
    known = {h.name: h for h in candidates().asked}
    return {
        "records": {"fit": [r.name for r in recording.used_for("fit")],
                    "heldout": [r.name for r in recording.used_for("heldout")]},
        "ladder": steps_table(whole.question.fit, steps), "inside": list(inside(steps)), "refused": refused,
        "verdict": whole.diagnosis.verdict, "again": list(named_again(recording, whole.diagnosis)),
        "equations": {name: known[name].equation for name in inside(steps)},
        "parameters": parameters(full, effective_samples(heldout, full)),
        "figures": {"record": traces(heldout, uses, SHOWN)},
        "concealed": ablations(whole, tell),
        "feedforward": replayed(heldout, uses),
        "pitch": pitch(folder, full.free, full.values),
        "elsewhere": elsewhere(folder, whole),
        "published": PUBLISHED,
        "compare": compare(recording, full.free, full.values, controls=controls, tell=tell),
    }  # fmt: skip


def rounded(value: Any) -> Any:
    """Numbers to five significant digits: what is kept in the repository."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item) for item in value]
    return float(f"{value:.5g}") if isinstance(value, float) else value


if __name__ == "__main__":
    found = study(sys.argv[1], tell=lambda text: print(text, flush=True))
    Path(sys.argv[2]).write_bytes(packed_json(rounded(found)))
