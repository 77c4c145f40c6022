"""Stillness detection: windows of samples judged against the device's own noise; single-sample spikes are corrected."""
