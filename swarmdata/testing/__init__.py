"""Contract suites and synthetic data, for this library's tests and for its users'."""
