"""From a search to an answer: the corrected rig, confidences, places, words."""
