"""From records to a ranked board: scores, statistics, tables, figures, pages."""
