"""The next experiment: the motion of which the record would settle what the last records left open.

==============  =========================================================================================
`design`        `next_experiment`: motions are drawn, simulated under every rival, and the best is refined
`rivals`        the models that an answer cannot tell apart, refitted to the records there are
`bench`         what each rival predicts of motions that were not run
`worth`         log odds and intervals to be expected of a motion, in closed form
`motions`       families of motions within the limits of a drive
`settings`      what of the rig can be set for it, besides the motion
`plan`          the experiment as a reference file, with what to expect of it
==============  =========================================================================================

Sources: Box, Hill, Technometrics 9 (1967) 57 (experiments that discriminate between models by the expected change of
entropy); Atkinson, Fedorov, Biometrika 62 (1975) 57 (T-optimality); Chaloner, Verdinelli, Statist. Sci. 10 (1995) 273.
"""
