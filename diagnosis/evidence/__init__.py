"""Evidence of a model: the model, what it may be off by, and noise in one likelihood; and what it leaves."""
