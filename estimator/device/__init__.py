"""State of one device: takes samples; gives corrected rates, calibrations and a status.

Pure: no clock, socket, file or thread.

Start reading at `session`. `corrected_stream` corrects samples, and updates the estimates from blocks of samples by
`boot_estimation` and `boot_calibration`. `lifecycle` is the table of a device's states. `admission` decides which
messages are accepted, `sequence_numbers` drops duplicate samples. `correction` chooses the correction parameters and
their uncertainty; `bridge.wire.messages.combined_std` combines them into the standard deviation of a rate.
"""
