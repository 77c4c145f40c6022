"""The estimator as a service: the shell around the sessions."""
