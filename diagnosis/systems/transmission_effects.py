"""Effects of a lumped cable transmission as hypotheses: the plant's own declarations, and where a search begins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cable_envs.core.errors import require_known
from cable_envs.diagnosis.model.hypotheses import Candidates, Hypothesis, unsearched
from cable_envs.diagnosis.model.model import Free
from cable_envs.diagnosis.systems.common import fitted_rig
from cable_envs.diagnosis.systems.question import Request
from cable_envs.effects import EFFECTS
from cable_envs.plants.transmission.effects import FORMS
from cable_envs.plants.transmission.plant import PLANT


@dataclass(frozen=True)
class Limit:
    """Unit, null, bounds and a size that matters (SI) of one parameter; ``shape``: its null alone says nothing."""

    unit: str
    null: float
    low: float
    high: float
    scale: float
    shape: bool = False

    def at(self, start: float, name: str) -> Free:
        """The parameter of a refit that begins at ``start``."""
        return Free(name, start, self.low, self.high, self.scale)


_SIZES = {"ratio": 1.0, "torque_zero": 0.01, "torque_constant": 0.1}
"""Sizes of the plant's own parameters."""
_SENSORS = {
    "sensor_scale.output_torque": Limit("1", 1.0, 0.3, 3.0, 0.05),
    "sensor_delay.output_angle": Limit("s", 0.0, 0.0, 0.2, 0.02),
}
"""What is looked for of the sensors, and how far: a bias is the angle's or the torque's zero."""


def _limits() -> dict[str, Limit]:
    own = {p.name: Limit(p.unit, p.default, p.low, p.high, _SIZES[p.name]) for p in PLANT.parameters}
    effects = {
        f"{form.name}.{p.name}": Limit(p.unit, p.null, p.low, p.high, p.typical, p.shape)
        for form in FORMS
        for p in form.parameters
        if not p.shape or p.probes
    }
    return {**own, **effects, **_SENSORS}


LIMITS: Mapping[str, Limit] = _limits()
"""What a refit may move. Bounds are wide: what a tool's drive can have, in either sense."""
NULLS: Mapping[str, float] = {name: limit.null for name, limit in LIMITS.items()}
_ZEROS = {"sensor_bias.output_angle": "zero of the angle", "sensor_bias.output_torque": "torque_zero"}
"""What the nominal parameters do as well."""
SIZES = (0.1, 1.0)
"""Probed sizes over `Limit.scale`."""
NAMES = tuple(dict.fromkeys(n if n.startswith("sensor_") else n.split(".")[0] for n in LIMITS if "." in n))
"""Hypotheses; a sensor's effect is one for each signal."""


def candidates(request: Request | None = None, base: Mapping[str, float] | None = None) -> Candidates:
    """What the transmission of ``base`` may lack, by default the rigid, frictionless one.

    Raises ConfigurationError for unknown names.
    """
    request, base = request or Request(), base or NULLS
    for name in (*(request.only or ()), *request.without):
        require_known("effect", [name], EFFECTS)

    def wanted(name: str) -> bool:
        effect = name.split(".")[0]
        return effect not in request.without and (request.only is None or effect in request.only)

    found = Candidates(tuple(_hypothesis(name) for name in NAMES if wanted(name)))
    there = {
        h.name: "the rig has it" for h in found.asked if any(base.get(n, null) != null for n, null in h.nulls.items())
    }
    others = {name: why for name, why in unsearched(PLANT, NAMES, _ZEROS).items() if wanted(name)}
    return found.less(there).and_also(Candidates((), others))


def _hypothesis(effect: str) -> Hypothesis:
    """The effect as one that may be missing."""
    form = PLANT.effects.effects[effect.split(".")[0]]
    mine = {name: limit for name, limit in LIMITS.items() if name == effect or name.startswith(f"{effect}.")}
    sizes = {name: limit for name, limit in mine.items() if not limit.shape}
    shapes: list[dict[str, float]] = [{}]
    for p in form.parameters:
        if p.shape and p.probes:
            row = f"{form.name}.{p.name}"
            shapes = [{**s, row: factor * p.typical} for s in shapes for factor in p.probes]
    probes = tuple(
        tuple({name: limit.null + size * limit.scale, **shape} for name, limit in sizes.items())
        for size in SIZES
        for shape in shapes
    )
    return Hypothesis(
        effect, tuple(limit.at(limit.null, name) for name, limit in mine.items()), probes, form.equation,
        form.experiment, form.confusable, {name: limit.null for name, limit in sizes.items()}, form,
    )  # fmt: skip


def rig_of(values: Mapping[str, float], accepted: Sequence[str] = (), name: str = "augmented") -> dict[str, Any]:
    """Content of augmented.yaml: a rig of the plant ``transmission`` with exactly these numbers.

    Parameters
    ----------
    values : mapping of str to float
        By name of the plant's table, SI; ``zero.GROUP`` is the zero of the output angle's sensor in a group of records.
    accepted : sequence of str
        Names of hypotheses; what they bring is in ``values``, and every value that is not at its null is written.
    name : str
        Of the rig.

    Returns
    -------
    dict
        Of the schema of `cable_envs.sim.rigs`. One zero of the angle is the bias of its sensor; where there are
        several, they are those of the groups and not of the rig, and its description says so.
    """
    zeros = {key.removeprefix("zero."): float(v) for key, v in values.items() if key.startswith("zero.")}
    given = {key: v for key, v in values.items() if key in PLANT.table}
    if len(zeros) == 1:
        given["sensor_bias.output_angle"] = next(iter(zeros.values()))
    rig = fitted_rig(PLANT, given, name)
    if len(zeros) > 1:
        said = ", ".join(f"{group} {value:.9g}" for group, value in zeros.items())
        rig["description"] = f"not of the rig, but of each group of records: zero of the output angle, rad: {said}"
    return rig
