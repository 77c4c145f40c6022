"""The estimator's tables of a ward's file, and the settings that follow from a kind of device.

Start reading at `schema.Ward`.
"""
