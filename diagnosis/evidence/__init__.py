"""Evidence of hypotheses: models, what they may be off, and noise in one likelihood (`search`)."""
