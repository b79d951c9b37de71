"""Is what is left after a refit noise? Tests of residuals over position, speed, time and frequency."""
