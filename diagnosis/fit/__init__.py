"""Refits, likelihood, score tests of hypotheses, covariance, localisation."""
