"""Names and descriptions of the studies, importable without their numerical libraries."""

STUDIES = {
    "typical": "one simulated session with the stages that are found in it (figure 6)",
    "errors": "errors of bias and scale in simulated sessions, parameter by parameter (figure 7)",
    "testset": "mean error of the rate on a test set, before and after calibration (figure 8)",
    "sensors": "the paper's two sensors by its four methods and closure (tables 2 and 3)",
    "magnitude": "magnitude of a known rate about x, y, z, before and after calibration (figure 9)",
    "orientation": "orientation over ±360° about x, y, z, before and after calibration (figures 2, 10)",
    "analysis": "effects of noise, sampling rate, hand and times on the scale factor (the error analysis)",
    "real": "a real session through every method that applies, beside imucal's numbers",
}
