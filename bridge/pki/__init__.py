"""Certificates, which say who is who on the bus: made here, or brought along."""
