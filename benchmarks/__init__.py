"""Speed only: how many steps a second, as ratios to peers measured in the same run. `python -m benchmarks`."""
