"""A single pulley: what its support costs, how far the cable slips, how much the wrapped part stretches."""
