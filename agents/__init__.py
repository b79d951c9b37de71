"""Learning agents on the native batch: training, saving, loading (stable-baselines3). The only package with torch."""

if __name__ != "cable_envs.agents":
    raise ImportError("the folder agents/ of this checkout is imported as cable_envs.agents")
