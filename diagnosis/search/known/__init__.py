"""What is known of records before the search asks what is missing: their clock, their noise, samples that may lie."""
