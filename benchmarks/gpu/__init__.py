"""Batches on a GPU against the CPU: what is measured, and the tables of docs/gpu.md (`python -m benchmarks.gpu`)."""
