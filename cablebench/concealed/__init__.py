"""The concealed-physics track: control of rigs that have what no simulator of the entrant has.

An entrant is given recordings of a hidden rig and the simulator that everybody believes in, and prepares a controller
(or a policy). It is ranked by how well that tracks on the hidden rig. `mechanism` says what a hidden rig is, `hidden`
draws and seals it, `records` records it, `given` is what an entrant has, `entrants` are the rows that are always there,
`track` runs, `worth` and `page` sum up.
"""
