"""Tuning by trials: the space, the objective, the study."""
