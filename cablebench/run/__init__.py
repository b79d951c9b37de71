"""Running the episodes of a protocol and keeping their records."""
