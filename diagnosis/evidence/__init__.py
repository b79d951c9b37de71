"""Evidence of hypotheses: a model, what it may be off by, and noise in one likelihood (`search`).

In development: `cable_envs.diagnosis.engine` does not use it yet. It is to replace `search`, `adequacy` and
`fit.confidence`.
"""
