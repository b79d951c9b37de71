"""Rigs that leave the package: as Python, as C, as an FMU, as a MuJoCo model, from the simulator's own stage functions."""
