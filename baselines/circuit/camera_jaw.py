"""The virtual jaw with a camera that sees the jaw seldom and late.

Between two pictures `play.PlayFilter` follows the jaw from angle and torque of the drive. A picture tells where the jaw
was when it was taken: a share of the difference to what the filter had then moves the filter's jaw and its zero, so
that neither the encoder's unknown zero nor what the filter adds up lasts. The share falls from 1 with the number of
pictures (the mean of what they say) until it is ``camera``, as the filter drifts.
"""

from collections import deque
from collections.abc import Mapping
from typing import ClassVar

from cable_envs.baselines.base import Levels, Reference
from cable_envs.baselines.circuit.virtual_jaw import VirtualJaw
from cable_envs.core.params import Parameter, ParameterTable


class CameraJaw(VirtualJaw):
    """Virtual jaw whose zero comes from late pictures of the output."""

    name = "camera-jaw"
    plants: ClassVar[tuple[str, ...]] = ("pulley_chain",)
    tasks: ClassVar[tuple[str, ...]] = ("position",)
    modes: ClassVar = ("position",)
    levels: ClassVar[Mapping[str, str]] = Levels({"pulley_chain": "output"})
    gain_tables: ClassVar = {
        case: ParameterTable(
            *table,
            Parameter("camera", "1", 0.3, 1e-3, 1.0, "share of what a picture shows otherwise that is believed"),
            Parameter("late", "s", 0.1, 0.0, 1.0, "age of a picture when it is seen"),
            Parameter("closes", "1/s", 3.0, 0.1, 1e3, "rate at which an error is closed before the reference moves"),
        )
        for case, table in VirtualJaw.gain_tables.items()
        if case[1:] == ("position", "position")
    }

    def reset(self) -> None:
        super().reset()
        self._shown: float | None = None
        self._pictures = 0
        self._past: deque[float] = deque(maxlen=round(self.gains["late"] / self.dt) + 1)
        self._from: float | None = None

    def act(self, t: float, y: Mapping[str, float], ref: Reference) -> float:
        if not self._begun:
            self._begun = True
            self.jaw.begin(y["output_angle"], y["drive_angle"], y["drive_torque"])
            self._from = y["output_angle"]
        command = super().act(t, y, self._approached(ref))
        self._past.append(self.jaw.output)
        self._look(y["output_angle"])
        return command

    def _approached(self, ref: Reference) -> Reference:
        """The reference, towards which the jaw goes from where it began in a smooth way."""
        assert self._from is not None
        self._from += (ref[0] - self._from) * min(self.gains["closes"] * self.dt, 1.0)
        if ref[1] != 0.0:
            self._from = ref[0]
        away = ref[0] - self._from
        if abs(away) < self.gains["tolerance"]:
            return ref
        return self._from, away * self.gains["closes"], 0.0

    def _look(self, shown: float) -> None:
        """A new picture moves the filter's jaw by a share of what it shows otherwise."""
        if shown == self._shown:
            return
        first, self._shown = self._shown is None, shown
        if first:
            return
        self._pictures += 1
        share = max(self.gains["camera"], 1.0 / (self._pictures + 1.0))
        missed = share * (shown - self._past[0])
        self.jaw.shift(missed)
        for k in range(len(self._past)):
            self._past[k] += missed
