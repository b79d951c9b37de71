"""Feedforward of the dead zone with a virtual sensor of the jaw and a search for breakaway.

The tip of a surgical instrument carries no sensor. `play.PlayFilter` estimates the output, the friction and the
compliance from angle and torque of the drive. The drive is then told the angle, or the torque, with which the output is
at the reference on the working line of the way that it moves. An integral of the estimated error corrects the rest.

**Search for breakaway.** While the reference stands still, the drive goes slowly to the end of the dead zone. The
torque climbs until the output moves: this plateau is the friction, and the climb the compliance, so that both are known
before the reference moves. The drive then waits at the end of the dead zone: where an error was brought back from the
other side, with the gain ``edge`` at that share of it on the side to which the reference went last, or else upwards.

**Jumps** of an angle are crossed by `crossing.Crossing` where the gain ``hurry`` is above zero; the integral rests
meanwhile, as that error is no fault of the estimate.

An episode is taken to begin with the output on its reference: of the drive's sensors none tells another beginning.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

from cable_envs.baselines.base import CIRCUITS, Controller, Reference
from cable_envs.baselines.circuit.crossing import JUMP, Crossing
from cable_envs.baselines.circuit.play import PlayFilter
from cable_envs.baselines.circuit_model import CircuitModel
from cable_envs.baselines.parts import FilteredRate, Smoother, follow_direction, has_jumped
from cable_envs.core.params import Parameter, ParameterTable

STANDS = 0.3
"""s without a change of the reference after which it counts as standing"""

LARGEST = 0.3
"""Largest correction by the integral, as a share of the scale of the output."""


def _gains(mode: str, task: str) -> ParameterTable:
    held = task == "position"
    unit, tolerance, ki, misfit, walk = ("rad", 2e-3, 11.0, 3e-3, 3e-4) if held else ("N m", 2e-3, 0.5, 5e-3, 3e-3)
    hurry = Parameter("hurry", "1", 0.0, 0.0, 10.0, "share of the drive's acceleration that crosses a jump; 0: none")
    edge = Parameter("edge", "1", 0.0, 0.0, 10.0, "half widths of the dead zone at which the drive waits; 0: no place")
    return ParameterTable(
        Parameter("ki", "1/s", ki, 1e-4, 1e4, "integral gain of the estimated error"),
        Parameter("kp", "N m/rad", 5.0 if held else 0.0, 0.0, 1e3, "torque per angle of the drive (torque commands)"),
        Parameter("kd", "N m s/rad", 0.02, 0.0, 30.0, "torque per speed of the drive (torque commands)"),
        Parameter("lead", "s", 0.01, -0.5, 0.5, "how far ahead the reference is taken"),
        Parameter("turn_time", "s", 0.03 if mode == "position" else 0.05, 1e-4, 10.0,
                  "time constant of changes of direction, and of jumps of a torque"),
        Parameter("search", "1/s", 0.5, 1e-3, 1e3, "half widths of the dead zone per second of the search"),
        Parameter("tolerance", unit, tolerance, 1e-6, 1.0, "error at rest that is brought back"),
        Parameter("beyond", "rad", 1e-3 if held else 1.5e-3, 1e-6, 1.0, "drive angle beyond the hold at breakaway"),
        Parameter("misfit", "N m", misfit, 1e-6, 10.0, "standard deviation of the drive torque about the model"),
        Parameter("walk", "1/sqrt(s)", walk, 1e-9, 100.0, "how far ln phi walks in a second"),
        edge,
        *((hurry,) if held and mode == "position" else ()),
    )  # fmt: skip


FARTHEST = 5.0
"""Half widths of the estimated dead zone after which the search gives up"""

HURRY = 3.0
"""Half widths per second by which the drive goes beyond the estimated dead zone while the reference already moves"""

BACK = 2.0
"""Tolerances of error at rest from which the drive goes to the other side of the dead zone"""


class VirtualJaw(Controller):
    """Inverse of the circuit on its estimated working lines, and an integral of the estimated error."""

    name = "virtual-jaw"
    charged: ClassVar = {"tuning_trials": 60}
    """for a case: on steps, sinusoids, multisines and random steps of nominal and randomised rigs"""
    information = "nominal"
    plants: ClassVar[tuple[str, ...]] = CIRCUITS
    tasks: ClassVar[tuple[str, ...]] = ("position", "torque")
    gain_tables: ClassVar = {
        ("circuit", mode, task): _gains(mode, task)
        for mode in ("position", "torque")
        for task in ("position", "torque")
    }

    def use_rig(self, rig: Mapping[str, Any]) -> None:
        super().use_rig(rig)
        g, model = self.gains, CircuitModel(self.rig)
        model.require_contact(self.task)
        stiffness = self.rig["contact_stiffness"] if self.task == "torque" else 0.0
        self.jaw = PlayFilter(model, stiffness, g["misfit"], g["walk"], g["beyond"], self.dt)
        self._side = Smoother(self.dt, g["turn_time"])
        self._jumps = Smoother(self.dt, g["turn_time"] if self.action_mode == "torque" else 0.0)
        self._speed = FilteredRate(self.dt, 0.0)
        self._crossing = Crossing(self.rig, g.get("hurry", 0.0), self.dt)
        self._largest = LARGEST * (1.0 if self.task == "position" else self.rig["contact_stiffness"])

    def reset(self) -> None:
        self._begun = False
        self._direction, self._place, self._still = 0.0, 0.0, 0.0
        self._onward = 1.0
        self._last: float | None = None
        self._correction, self._beyond = 0.0, 0.0
        self._crossing.on, self._told = False, 0.0
        self._side.reset()
        self._jumps.reset()
        self._speed.reset()

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        g, angle, torque = self.gains, y["drive_angle"], y["drive_torque"]
        if not self._begun:
            self._begun = True
            self.jaw.begin(ref[0], angle, torque)
        self.jaw.update(angle, y["drive_velocity"], torque)
        error = ref[0] - self.jaw.output
        if has_jumped(ref, self._last, self.dt, JUMP):
            self._crossing.begin()
        self._turn(ref, error)
        if not self._crossing.on and (self._still < STANDS or abs(error) > g["tolerance"]):
            self._correction += g["ki"] * error * self.dt
            self._correction = min(max(self._correction, -self._largest), self._largest)
        target = self._jumps.update(ref[0] + g["lead"] * ref[1], ref[1]) + self._correction
        held, needs = self.jaw.held_at(target, self._place)
        if self.action_mode == "position":
            if self._crossing.on:
                held = self._crossing.command(held, angle, y["drive_velocity"], self._told)
            self._told = self.limit(held)
            return self._told
        rate = self._speed.update(held)
        return self.limit(self.driven(held - angle, rate, needs, y))

    def driven(self, away: float, rate: float, needs: float, y: Mapping[str, float]) -> float:
        """The torque command for a drive that is ``away`` (rad), is to move at ``rate`` and to give ``needs`` (N m)."""
        g = self.gains
        damped = g["kd"] * (rate - y["drive_velocity"]) + self.rig["drive_damping"] * rate
        return needs + g["kp"] * away + damped

    def _turn(self, ref: Reference, error: float) -> None:
        """The side of the dead zone at which the drive is to be; beyond 1 while breakaway is searched."""
        g, moved = self.gains, ref[1] != 0.0 or (self._last is not None and ref[0] != self._last)
        self._still = 0.0 if moved else self._still + self.dt
        self._direction = follow_direction(self._direction, self._last, ref)
        self._last = ref[0]
        if moved:
            self._onward = self._direction
        if self._still < STANDS:
            self._go()
            return
        way, step = self._direction or 1.0, g["search"] * self.dt
        if not self.jaw.moved and abs(self._place) < FARTHEST:
            self._place += way * step
            return
        if abs(error) > BACK * g["tolerance"]:
            self._direction = 1.0 if error > 0.0 else -1.0
            way = self._direction
        elif g["edge"] > 0.0 and abs(error) < g["tolerance"]:
            self._direction = self._onward
            way = g["edge"] * self._onward
        self._place = min(max(self._place, -1.0), 1.0)  # the search had gone by another friction
        self._place += min(max(way - self._place, -step), step)

    def _go(self) -> None:
        """While the reference moves: to the side of its direction, and beyond until the output breaks away."""
        if self._direction == 0.0:
            return
        self._side.value = min(max(self._place, -1.0), 1.0)
        self._place = self._side.update(self._direction)
        self._beyond = 0.0 if self.jaw.moved else self._beyond + HURRY * self.dt
        self._place += self._beyond * self._direction
