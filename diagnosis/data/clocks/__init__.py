"""The clocks of records: their periods, when samples were taken, and clocks that they were brought to another from."""
