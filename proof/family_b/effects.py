"""What generator B conceals: effects of the canonical list under laws in several forms, and physics of no library.

Names, units and what a recording claims beside an effect are those of generator A (`cable_envs.proof.effects`): they
are the question. The laws are generator B's own (`simulators.laws`): a form is drawn with every effect that has more
than one, and a parameter counts for the coverage of intervals only where the form is the documented one, for otherwise
the two laws have no number in common.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from cable_envs.proof import effects as first
from cable_envs.proof.effects import SYSTEMS, Missing

ANY_OF_THREE, ANY_OF_TWO = (-0.5, 2.5), (-0.5, 1.5)
"""Ranges of a form that is drawn evenly: below 0.5 the documented one."""


@dataclass(frozen=True)
class Concealed(Missing):
    """One effect of generator B.

    Attributes
    ----------
    forms : tuple of str
        Parameters of the simulator that choose the law; the documented one below 0.5.
    """

    forms: tuple[str, ...] = ()

    def comparable(self, drawn: Mapping[str, float]) -> Mapping[str, tuple]:
        """What of ``compare`` means the same in the law that was drawn."""
        return self.compare if all(drawn[name] < 0.5 for name in self.forms) else {}


_FORMS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "stribeck_friction": {"stribeck_friction.form": ANY_OF_THREE},
    "friction_drift": {"friction_drift.form": ANY_OF_TWO},
    "stiffness_hardening": {"stiffness_hardening.form": ANY_OF_TWO},
    "actuator_lag": {"actuator_lag.second": ANY_OF_TWO},
}
_SHAPES: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "position_ripple": {"position_ripple.second": (0.0, 0.4)},
    "viscoelastic_creep": {"viscoelastic_creep.second": (0.0, 0.6)},
}
"""What bends a law gradually. Amplitude and period of a ripple remain what they are; of creep nothing does."""
_BENT = ("viscoelastic_creep",)
_SPEEDS = {"linear_drive": (0.003, 0.04), "cable_hole": (8e-4, 7e-3), "pulley_circuit": (0.4, 2.5)}


def _second(system: str, effect: Missing) -> Concealed:
    """The effect with generator B's law in place of generator A's."""
    forms = _FORMS.get(effect.name, {})
    shaped = {**effect.shaped, **forms, **_SHAPES.get(effect.name, {})}
    compare = dict(effect.compare)
    if effect.name == "stribeck_friction":
        shaped["stribeck_friction.speed"] = _SPEEDS[system]
    if effect.name == "friction_drift":
        shaped["friction_drift.time"] = (4.0, 25.0)
    if system == "linear_drive" and effect.name == "asymmetric_friction":
        compare = {"difference": ("asymmetric_friction.difference", 1.0, "N")}
    if effect.name in _BENT:
        compare = {}
    sized = {name: 1.7 * unit for name, unit in effect.sized.items()}  # another start of the search for a size
    return Concealed(
        effect.name, sized, shaped, compare, effect.known, effect.signed, max(effect.largest / 1.7, 1.0), tuple(forms)
    )  # fmt: skip


LIBRARY: Mapping[str, tuple[Concealed, ...]] = {
    system: tuple(_second(system, effect) for effect in first.LIBRARY[system]) for system in SYSTEMS
}

_DRAUGHT = {"draught.time": (0.7, 4.0)}


def _strange(name: str, sized: Mapping[str, float], shaped: Mapping | None = None, largest: float = 30.0) -> Concealed:
    return Concealed(name, sized, shaped or {}, largest=largest)


STRANGE: Mapping[str, tuple[Concealed, ...]] = {
    "linear_drive": (
        _strange("slosh", {"slosh.mass": 0.3}, {"slosh.frequency": (4.0, 15.0)}),
        _strange("quadratic_drag", {"quadratic_drag.coefficient": 30.0}),
        _strange("supply_sag", {"supply_sag.share": 0.02}, {"supply_sag.time": (0.2, 2.0)}, 12.0),
        _strange("belt_tooth", {"belt_tooth.force": 2.0}, {"belt_tooth.place": (-0.02, 0.02)}),
        _strange("draught", {"draught.force": 1.0}, _DRAUGHT),
        _strange("sensor_compressive", {"compressive:position": 0.01}, largest=20.0),
        _strange("sensor_missed_counts", {"missed_counts:position": 1e-4}),
    ),
    "cable_hole": (
        _strange("wet_hole", {"wet_hole.depth": 0.2}, {"wet_hole.place": (0.012, 0.024)}, 4.5),
        _strange("swinging_load", {"swinging_load.mass": 0.2}, {"swinging_load.frequency": (4.0, 12.0)}),
        _strange("rolling_support", {"rolling_support.amplitude": 1e-4}, {"rolling_support.period": (7.0, 25.0)}),
        _strange("draining_load", {"draining_load.rate": 1e-3}, largest=20.0),
        _strange("draught", {"draught.force": 1.0}, _DRAUGHT),
        _strange("sensor_missed_counts", {"missed_counts:load_position": 5e-5}),
    ),
    "pulley_circuit": (
        _strange("swinging_tip", {"swinging_tip.inertia": 1e-4}, {"swinging_tip.frequency": (4.0, 15.0)}),
        _strange("worn_place", {"worn_place.torque": 5e-3}, {"worn_place.place": (-0.3, 0.3)}),
        _strange("draught", {"draught.torque": 5e-3}, _DRAUGHT),
        _strange("loose_clamp", {"loose_clamp.step": 1e-4}),
        _strange("sensor_missed_counts", {"missed_counts:output_angle": 2e-3}),
    ),
}
"""Physics that the tool's library does not hold: the right answer is "unknown"."""


def find(system: str, name: str) -> Concealed:
    """The effect of a name on a system.

    Parameters
    ----------
    system : str
        One of `cable_envs.proof.effects.SYSTEMS`.
    name : str
        Of an effect of `LIBRARY` or `STRANGE`.

    Returns
    -------
    Concealed
        The effect.

    Raises
    ------
    KeyError
        Where there is none.
    """
    for effect in (*LIBRARY[system], *STRANGE[system]):
        if effect.name == name:
            return effect
    raise KeyError(f"{system} has no effect '{name}'")
