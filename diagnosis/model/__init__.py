"""What is common to all systems: residual model, noise, hypotheses, the verdict."""
