"""Both papers recomputed: every table and figure beside the printed numbers.

An item is one module with a function ``reproduce(progress) -> Result``, named in
`cable_envs.reproduction.registry.ITEMS`::

    def reproduce(progress: Progress) -> Result:
        progress(0.0, "nine cables")                          # share done, what is being done
        rows = [parameter("mu of the 2 mm fibre cable", 0.43, value, "1", how="Least squares on data without noise."),
                missing("amplitude of the sinusoid", None, None, "m", "The paper does not print it.")]
        svg = style.svg(draw, style.PAGE, 3.0)                # draw(figure) on an empty matplotlib Figure
        return Result(rows, figures=(Figure("map", "Caption with a full stop.", svg),),
                      tables=(Extra("What the paper does not have", ("method", "success"), [("lsq", "20 of 20")]),),
                      notes=("A sentence for the report.",))

The kind of a row decides how close counts (`cable_envs.reproduction.yardstick`); no module chooses a tolerance.
`Result.rows` become the JSON; figures, extra tables and notes go into the report only. Progress, two processes, files
and the page are the registry's and the report's business.
"""

if __name__ != "cable_envs.reproduction":
    raise ImportError("the folder reproduction/ of this checkout is imported as cable_envs.reproduction")
