"""Refits, likelihood, screening of hypotheses, localisation."""
