"""Recordings of real rigs: reading and checking them (`recording`)."""
