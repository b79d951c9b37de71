"""Blind proof of the diagnosis: concealed effects from generators of its own, sealed keys, a scorer, baselines.

Nothing here imports the simulators of cable_envs: truth and tool share no integrator and no formulation of friction.

linear_drive, cable_hole, pulley_circuit   the generators, one file each; `numerics` holds their hysteresis
effects      what can be missing: parameters, random sizes, systems; also what is in no library
excitation   reference motions;  sensors   noise, quantisation, clocks
cases        a seed makes a recording folder and its key; `refit` sets the size of an effect against the refit
sealing      keys with salted hashes, fixed before the tool runs
scoring      tables and limits;  baselines   what the same cases look like to simpler methods
"""

if __name__ != "cable_envs.proof":
    raise ImportError("the folder proof/ of this checkout is imported as cable_envs.proof")
