"""What may be wrong with a machine or a ward: small checks, each told what to look at, each with what to do."""
