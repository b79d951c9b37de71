"""Diagnosis of the public recordings: each data set with what its own task asks."""
