"""Alerts to people: a fault that lasts longer than its hold time raises one alert, until the fault has ended.

`board.py` decides which alerts are raised and cleared, `outbox.py` groups them and keeps quiet hours (both pure).
`sender.py` sends them by apprise.
"""
