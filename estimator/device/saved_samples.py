"""Serialisable form of a boot's samples, stored by column."""

import numpy as np

from estimator.samples.sample_buffer import HOST_NS, SEQUENCE, TIME, WIDTH, Floats, SampleBuffer
from estimator.state import StateStruct, shaped


class SavedSamples(StateStruct):
    """Samples that the estimation still needs, by column, numbered from `first` on.

    time: bit patterns of device times in s, as integers. sequence: sequence numbers. host_ns: host times, ns since the
    Unix epoch. Time, sequence and host_ns are stored as differences between samples.
    rows (n, 8): gyro (3, rad/s), accelerometer (3, m/s²), clipped or stuck (0 or 1), temperature (°C).
    """

    first: int
    time: list[int]
    rows: Floats
    sequence: list[int]
    host_ns: list[int]

    @classmethod
    def of(cls, buffer: SampleBuffer, end: int) -> "SavedSamples":
        """Copy the samples of a buffer that are numbered below `end` into columns."""
        rows, places = buffer.rows(buffer.begin, end), buffer.places(buffer.begin, end)
        time = np.ascontiguousarray(rows[:, TIME]).view(np.int64)
        columns = (np.diff(column, prepend=0).tolist() for column in (places[:, SEQUENCE], places[:, HOST_NS]))
        return cls(buffer.begin, np.diff(time, prepend=0).tolist(), np.delete(rows, TIME, axis=1), *columns)

    def buffer(self) -> SampleBuffer:
        """Rebuild the sample buffer. Raises ValueError if the columns differ in length or shape."""
        n = len(self.time)
        shaped(self.rows, n, WIDTH - 1)
        if not n == len(self.sequence) == len(self.host_ns):
            raise ValueError("damaged state: the columns of samples differ in length; start without this state")
        time, sequence, host_ns = (
            np.cumsum(np.array(column, np.int64)) for column in (self.time, self.sequence, self.host_ns)
        )
        buffer = SampleBuffer(self.first)
        places = np.column_stack([sequence, host_ns, np.zeros(n, np.int64)])
        buffer.put([(np.insert(self.rows, TIME, time.view(np.float64), axis=1), places)])
        return buffer
