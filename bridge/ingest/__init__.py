"""From a driver's events to published batches: clock, order, gaps, boots, sensor faults; a thread a device, one pump."""
