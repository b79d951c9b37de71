"""The process of a stranger's file: what walls stand around it, how it begins, and what it answers."""
