"""Views of a ward as plain values, computed from bus messages: devices, problems for people, estimators. Pure.

Start reading at `ward`.
"""
