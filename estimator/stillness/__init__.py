"""Still or moving: windows of samples, judged against the device's own noise; lone spikes are mended.

Begin at `detector`.
"""
