"""Generator A with logs as rigs make them: the same rigs and effects, recorded by loggers that are not perfect.

The recordings of `cable_envs.proof.cases` come from a laboratory: noise that is stated or recorded at rest, and a clock
that is nearly even. Here each case has one kind of imperfect log, states no noise and has no record at rest. These
cases are for developing the diagnosis. Generator B judges it and has loggers of its own.
"""
