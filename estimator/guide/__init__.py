"""Step-by-step instructions for a person who calibrates a device by hand. Pure.

The instructions follow the sensor readings, so the person need not click. Start reading at `guide`.
"""
