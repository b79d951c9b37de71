"""What the tasks of suite v1 have more than a task and its options: levels, drawn signals, sensors, rules, prices."""
