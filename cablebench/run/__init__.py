"""Episodes of a protocol and their records: metrics, results store, provenance, replay."""
