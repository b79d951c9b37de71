"""Controllers of the tendon in a sheath."""
