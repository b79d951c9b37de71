"""A one-axis drive with friction, rigid or behind a belt."""
