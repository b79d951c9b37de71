"""Controllers of the pulley circuit that estimate what happens behind the drive."""
