"""From a ranked board to its HTML pages: the board's own, and one for each task with its traces. No network."""
