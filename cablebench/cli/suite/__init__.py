"""Commands of suites with frozen anchors: make the anchors, try an entrant on one task."""
