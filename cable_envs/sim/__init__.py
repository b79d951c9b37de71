"""Rigs, references and tasks; one or many environments in one compiled call; recorded inputs through many plants."""
