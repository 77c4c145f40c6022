"""Studies: scenario, table, figure."""
