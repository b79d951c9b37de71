"""What is refused before anything is fitted: unusable channels, scales, clocks."""
