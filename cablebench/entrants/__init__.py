"""Who takes part: controllers, policies, submitted files; what is checked before they do."""
