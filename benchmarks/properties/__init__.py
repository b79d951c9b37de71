"""Properties of the plants, measured over random rigs."""
