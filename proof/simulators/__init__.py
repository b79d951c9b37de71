"""Independent simulators of each system, in plain steps; nothing of the simulator under test is used."""
