"""Controllers of the cable-hole that compensate its friction from a model and correct the rest by feedback."""
