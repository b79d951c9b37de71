"""What several commands need: names and options from the command line, entrants by name, consoles, progress."""
