"""Logs of four rigs that no plant of this package is, made by MuJoCo, and what the tool says of them.

logs      sensors and clocks as rigs have them; a run as a CSV file
rigs      the four rigs: a rotary joint, a tendon over pulleys, a tendon-driven continuum, a carriage on a belt
"""
