"""The closed cable-pulley circuit of Zou et al. 2022: in closed form, and as a chain of spans and contacts."""
