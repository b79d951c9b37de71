"""Episodes as data: Minari datasets for offline learning (`minari`), recordings for diagnosis (`recording`)."""
