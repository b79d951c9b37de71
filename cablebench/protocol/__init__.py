"""What a benchmark is made of: protocol, episodes and their metrics, what acts in an episode, units for people."""
