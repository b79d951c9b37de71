"""The cable drawn through one or more holes of Gu et al. 2024."""
