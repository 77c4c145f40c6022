"""Alerts to people: a trouble that lasts longer than its hold time becomes one alert, until it has ended for a while.

`board.py` decides (pure), `outbox.py` gathers what is to be sent and keeps quiet hours (pure),
`sender.py` sends by apprise.
"""
