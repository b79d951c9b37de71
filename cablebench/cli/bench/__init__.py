"""Commands that run, score and rank controllers and policies."""
