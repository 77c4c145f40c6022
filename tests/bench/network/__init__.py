"""Two routers on a network that fails: routers killed, lines that lose packets or everything, a cut between two halves."""
