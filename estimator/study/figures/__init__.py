"""Figures of the studies; each module draws the results of one or more studies."""
