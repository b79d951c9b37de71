"""Tables and figures of Gu et al. 2024."""
