"""Views of a ward as plain values, computed from bus messages: devices, needs, estimators. Pure.

Start reading at `ward`.
"""
