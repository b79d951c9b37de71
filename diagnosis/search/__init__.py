"""Which effects explain a recording: model comparison, stepwise selection by held-out records, limit cycles."""
