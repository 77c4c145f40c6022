"""Draws a recording of LabRecorder: the rates of each device, and the markers. `python docs/lsl_picture.py IN.xdf OUT.svg`."""

import sys

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt
import numpy as np
import pyxdf


def main(file: str, picture: str) -> None:
    """Draw one panel a device, and a line for each marker."""
    streams, _ = pyxdf.load_xdf(file, verbose=False)
    rates = [stream for stream in streams if stream["info"]["name"][0].endswith(" rates")]
    markers = [
        (stamp, words[0])
        for stream in streams
        if stream["info"]["type"][0] == "Markers"
        for stamp, words in zip(stream["time_stamps"], stream["time_series"], strict=True)
    ]
    begin = min(stream["time_stamps"][0] for stream in rates)
    plt.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "truerate"})
    figure, panels = plt.subplots(len(rates), 1, figsize=(10, 2.4 * len(rates)), sharex=True, layout="constrained")
    for panel, stream in zip(np.atleast_1d(panels), rates, strict=True):
        device = stream["info"]["name"][0].removesuffix(" rates")
        times, values = stream["time_stamps"] - begin, np.degrees(stream["time_series"])
        times = np.insert(times, at := np.flatnonzero(np.diff(times) > 0.1) + 1, times[at])
        panel.plot(times[::2], np.insert(values, at, np.nan, axis=0)[::2], lw=0.8, label=["x", "y", "z"])
        for stamp, words in markers:
            whose, _, event = words.partition(" ")
            if whose == device:
                panel.axvline(stamp - begin, color="0.3", lw=0.8, ls="--")
                panel.text(stamp - begin, panel.get_ylim()[1], f" {event[:20]}", va="top", fontsize=7)
        panel.set_ylabel(f"{device}, °/s")
    np.atleast_1d(panels)[-1].set_xlabel("LSL time since the start, s")
    figure.legend(
        *np.atleast_1d(panels)[0].get_legend_handles_labels(), loc="outside upper right", ncols=3, frameon=False
    )
    figure.savefig(picture, metadata={"Date": None})


if __name__ == "__main__":
    main(*sys.argv[1:])
