"""HTML pages about diagnoses, recordings and the proof; their shared template."""
