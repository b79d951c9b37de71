"""The recording format and what it holds."""
