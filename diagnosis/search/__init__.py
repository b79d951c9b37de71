"""Which effects explain a recording: candidates, objections, selection, ladders."""
