"""Crashes, full disks and strangers' files: what was reported as saved stays, and what cannot be used is said."""
