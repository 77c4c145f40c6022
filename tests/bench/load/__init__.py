"""What the estimator carries, beside a bare relay that sends the same bytes on: `make bench-load`."""
