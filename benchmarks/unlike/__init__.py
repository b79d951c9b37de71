"""Logs of rigs that no plant of this package made, four by MuJoCo, and what the tool says of them.

logs      sensors and clocks as rigs have them; a run as a CSV file
rigs      MuJoCo's four: a rotary joint, a tendon over pulleys, a tendon-driven continuum, a carriage on a belt
sheath    a catheter, by the law of a tendon that rubs along all of its sheath
"""
