"""State of one device: samples in; corrected rates, calibrations and a status out. No clock, socket, file or thread.

Begin at `session`; `corrected_stream` corrects samples and updates the estimates from blocks of them, by
`boot_estimation` and `boot_calibration`. `lifecycle` is the table of a device's states, `admission` decides which
messages are accepted, `sequence_numbers` drops duplicate samples. `correction` chooses the parameters that are applied
and their uncertainty; `bridge.wire.messages.combined_std` combines them into the standard deviation of a rate.
"""
