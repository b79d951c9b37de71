"""Commands about recordings, identification, diagnosis and the two papers."""
