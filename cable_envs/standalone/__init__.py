"""Rigs that leave the package, as Python, C, an FMU or a MuJoCo model, from the simulator's own stage functions."""
