"""Identification of the cable-hole contact from measured tension ratios: three methods, and what none of them can tell.

`problem` states the cost (Eq. 23, Gu 2024); `pso` is the paper's swarm (Eqs. 24-27), `least_squares` and `cma_es` are
the alternatives; `information` says how well each parameter is determined. numpy, scipy and the kernels of `cable_envs`
only (`cma` for `cma_es`); nothing here knows environments.
"""

if __name__ != "cable_envs.identification":
    raise ImportError("the folder identification/ of this checkout is imported as cable_envs.identification")
