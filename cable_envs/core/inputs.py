"""What drives a plant: the rows of its input u, and the numbers of modes that are no action mode."""

from cable_envs.core.lanes import Lanes

INPUTS = Lanes("Inputs", ["command", "command_rate", "mode", "disturbance", "posture", "second", "second_rate"])
"""The drive command in the unit of the action mode, its rate, the number of the action mode (`Plant.number_of`), a
disturbance on the load (N or N m), by how much a posture bends the mechanism more than its rig says (rad), on plants
that have one (`Plant.posture`), and the second command with its rate, on plants that have such."""

FOLLOW, IMPOSED, OBSERVED, RAMPED = 7, 8, 9, 10
"""Numbers for the row mode above those of the action modes, for replays of recordings. FOLLOW: the drive's position
goes to `command` with the speed `command_rate` there (a cubic). IMPOSED: the drive's tension is `command`. OBSERVED
(linear_drive): the motor's force is `disturbance` plus what the servo adds to hold the carriage to `command`, whose
integral has the gain `second`. RAMPED is added to a number: the command goes there in a straight line over the control
step instead of jumping."""
