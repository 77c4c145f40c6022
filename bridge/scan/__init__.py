"""Which device is on which port: found, listened to, and guessed from its bytes."""
