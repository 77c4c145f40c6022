"""Configuration of the estimator: its tables of a ward's file, and the settings for each kind of device.

Start reading at `schema.Ward`.
"""
