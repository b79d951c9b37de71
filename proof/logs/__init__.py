"""Logs as rigs make them, for developing the diagnosis.

The recordings of `cable_envs.proof.cases` come from a laboratory: noise that is stated or recorded at rest, and a clock
that is nearly even. `cases` makes recordings of generator A with one kind of imperfect log each, which state no noise
and have no record at rest. `corruptions` makes faulty recordings of good ones. Generator B judges the diagnosis and has
loggers of its own.
"""
