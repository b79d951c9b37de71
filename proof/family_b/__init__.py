"""Generator B of the blind proof: other laws, integrators, motions and controllers than generator A, and real loggers.

It was written before the tool was run on it, and its sources are held by a hash (tests/proof): a change needs a new
generator. `cases.plan` and `cases.make` are what a proof needs; the rest serves them.

simulators   one file a system: set-valued friction on the velocity level, active sets, laws in several forms
effects      what is concealed, with the form of its law; physics of no library
excitation   reference motions;  logger   clocks, rows, encoders, filters, noise
rigs         generator A's random parameters under other controllers
odds         whether a recording can tell its effect from another at all
"""
