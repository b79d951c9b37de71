"""Tables and figures of Zou et al. 2022."""
