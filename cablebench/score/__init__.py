"""From errors to numbers that can be ranked: scores against frozen anchors, failures, intervals, paired comparisons."""
