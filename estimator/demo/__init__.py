"""The demonstration: a whole small ward in about a minute, judged against its own truth."""
