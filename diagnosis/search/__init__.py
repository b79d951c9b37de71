"""Which effects explain a recording: comparison of models by their evidence, limit cycles, where the mismatch is."""
