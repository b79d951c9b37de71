"""Learning agents on the native batch: training, saving, loading (stable-baselines3). The only package with torch."""

CABLE_BENCHMARK = True
"""Marks this package: other distributions also install a top-level `agents`, and callers check for this name."""
