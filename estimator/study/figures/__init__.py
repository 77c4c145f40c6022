"""The figures of the studies; each draws the results of one or more of them."""
