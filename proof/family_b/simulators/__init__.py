"""Simulators of generator B, one file a system: they share no step and no friction state with generator A."""
