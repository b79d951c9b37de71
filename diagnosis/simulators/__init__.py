"""A user's own simulator in the diagnosis: what it declares, how it is run, and what may be missing at its ports.

===============  ========================================================================================
`declaration`    names, units and bounds of its parameters, commands, outputs and ports
`base`           what every simulator can do; a simulator in a file, ``file.py:make``
`function`       a Python function over batches of columns
`environment`    a Gymnasium environment
`fmu`            a functional mock-up unit, through FMPy
`corrected`      a simulator with physics added at its ports
`effects`        laws at the ports that the library of effects does not have
`ports`          the forces of the laws at a port, in one compiled step
`signals`        what happens to a command before the simulator, and to an output behind it
`motion`         a whole run, with all of these
`asking`         which effects are asked, and at which sizes
`model`          a recording with a simulator as a `Model`
`question`       the question of a recording
===============  ========================================================================================
"""

from cable_envs.diagnosis.simulators.base import Simulator
from cable_envs.diagnosis.simulators.declaration import Command, Declaration, ForcePort, Output, SimulatorParameter
from cable_envs.diagnosis.simulators.environment import Action, Attribute, GymSimulator, Observation, Option
from cable_envs.diagnosis.simulators.fmu import FmuSimulator
from cable_envs.diagnosis.simulators.function import FunctionSimulator

__all__ = [
    "Action", "Attribute", "Command", "Declaration", "FmuSimulator", "ForcePort", "FunctionSimulator", "GymSimulator",
    "Observation", "Option", "Output", "Simulator", "SimulatorParameter",
]  # fmt: skip
