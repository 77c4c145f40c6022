"""Virtual devices with known truth; shares no code with the estimator."""
