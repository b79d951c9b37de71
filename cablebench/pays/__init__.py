"""Does a diagnosis pay: controllers and agents from the nominal, the corrected and the true simulator."""
